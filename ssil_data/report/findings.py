"""Segments to look at first: the least trusted with the reason, and the most disputed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.report.evidence import Evidence, Scored
from ssil_data.report.segments import Windows, correlations, standing, windows
from ssil_data.scoring import LeverageModel

SHOWN = 20
PER_EPISODE = 2
DIMENSIONS = 3


@dataclass(frozen=True)
class Dimension:
    """A state dimension that is a reason: its share of the uncertainty, where that is known.

    `value` is the mean over the segment; 90 % of the labeled pairs lie in `usual`; raw units.
    """

    name: str
    share: float | None
    value: float
    usual: tuple[float, float]

    @property
    def unusual(self) -> bool:
        """Tell whether the value lies outside of the usual range."""
        return not self.usual[0] <= self.value <= self.usual[1]


@dataclass(frozen=True)
class Reason:
    """Why a segment is distrusted: the parts of its uncertainty by name, and state dimensions."""

    parts: dict[str, float]
    dimensions: list[Dimension]


@dataclass(frozen=True)
class Segment:
    """Steps `first` to `last` of an episode, and what is known of it."""

    episode: int
    first: int
    last: int
    group: str
    source: str


@dataclass(frozen=True)
class Distrust:
    """A segment, its mean leverage and uncertainty under a run, and why it is distrusted."""

    segment: Segment
    leverage: float
    uncertainty: float
    reason: Reason


@dataclass(frozen=True)
class Dispute:
    """A segment and its standing under each run: the share of unlabeled pairs trusted less."""

    segment: Segment
    standings: list[float]


class Findings:
    """Asks one report's evidence for its segments; states are read for these alone."""

    def __init__(self, evidence: Evidence) -> None:
        """Look at the unlabeled episodes."""
        self.evidence = evidence
        self.windows: Windows = windows(evidence.lengths, ~evidence.labeled)
        self._first = np.cumsum(evidence.lengths) - evidence.lengths
        self._pairs = cache(self._read)

    def least_trusted(self, run: Scored) -> list[Distrust]:
        """Return the segments of the least leverage; of equals, the more uncertain first."""
        leverage = self.windows.means(run.leverage)
        uncertainty = self.windows.means(run.uncertainty)
        found = self.windows.least(leverage, -uncertainty, count=SHOWN, per_episode=PER_EPISODE)
        model = LeverageModel.of(self.evidence.dataset, run.name)
        return [
            Distrust(
                segment=self._segment(at),
                leverage=float(leverage[at]),
                uncertainty=float(uncertainty[at]),
                reason=self._reason(model, run, at),
            )
            for at in found
        ]

    @cached_property
    def standings(self) -> NDArray[np.float64]:
        """The standing of every pair under every run, (r, n), among the unlabeled pairs."""
        unlabeled = ~self.evidence.per_pair(self.evidence.labeled)
        return np.stack([standing(run.leverage, unlabeled) for run in self.evidence.runs])

    def agreement(self) -> NDArray[np.float64]:
        """Return Spearman's correlation of each run with each over the unlabeled pairs, (r, r)."""
        return correlations(self.standings[:, ~self.evidence.per_pair(self.evidence.labeled)])

    def disputes(self) -> list[Dispute]:
        """Return the segments whose standings under two runs lie furthest apart."""
        means = np.stack([self.windows.means(values) for values in self.standings])
        spread = means.max(axis=0) - means.min(axis=0)
        found = self.windows.least(-spread, means.min(axis=0), count=SHOWN, per_episode=PER_EPISODE)
        return [Dispute(self._segment(at), means[:, at].tolist()) for at in found]

    def _segment(self, at: np.int64) -> Segment:
        place = self.windows.episode[at]
        row = self.evidence.dataset.episodes.slice(place, 1).to_pylist()[0]
        return Segment(
            episode=row["episode"],
            first=int(self.windows.start[at] - self._first[place]),
            last=int(self.windows.stop[at] - self._first[place]) - 1,
            group=self.evidence.groups[self.evidence.group[place]],
            source=row["source"] or "",
        )

    def _reason(self, model: LeverageModel, run: Scored, at: np.int64) -> Reason:
        """Name the dimensions of the largest shares; without shares, the parts and the oddest."""
        rows = slice(self.windows.start[at], self.windows.stop[at])
        place = self.windows.episode[at]
        inside = slice(rows.start - self._first[place], rows.stop - self._first[place])
        pairs = self._pairs(int(place))
        state = pairs.states[inside].mean(axis=0)
        shares = model.estimator.shares(pairs)
        if shares is not None:
            mean = shares[inside].mean(axis=0)
            largest = _largest(mean)[:DIMENSIONS]
            return Reason({}, [self._dimension(i, state, float(mean[i])) for i in largest])
        low, high = self._usual
        beyond = np.maximum(low - state, state - high) / np.maximum(high - low, 1e-9)
        odd = [i for i in _largest(beyond)[: DIMENSIONS - 1] if beyond[i] > 0]
        return Reason(_parts(run, rows), [self._dimension(i, state, None) for i in odd])

    def _dimension(
        self, index: np.int64, state: NDArray[np.float32], share: float | None
    ) -> Dimension:
        low, high = self._usual[:, index]
        name = self.evidence.dataset.state_names[index]
        return Dimension(name, share, float(state[index]), (float(low), float(high)))

    @cached_property
    def _usual(self) -> NDArray[np.float64]:
        states = self.evidence.dataset.labeled().states
        return np.quantile(states, [0.05, 0.95], axis=0).astype(np.float64)

    def _read(self, place: int) -> Pairs:
        return self.evidence.dataset.episode(
            self.evidence.dataset.episodes["episode"][place].as_py()
        )


def _parts(run: Scored, rows: slice) -> dict[str, float]:
    sums = {part: float(values[rows].sum()) for part, values in run.parts.items()}
    whole = sum(sums.values())
    ordered = sorted(sums.items(), key=lambda item: -item[1])
    return {part: value / whole for part, value in ordered} if whole > 0 else {}


def _largest(values: NDArray[np.floating]) -> NDArray[np.int64]:
    return np.argsort(-values, kind="stable")
