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
CAUSES = 3


@dataclass(frozen=True)
class Cause:
    """A part of the uncertainty with its share of it, or a state dimension far from its usual.

    `value` is the mean over the segment; 90 % of the labeled pairs lie in `usual`; raw units.
    """

    name: str
    share: float | None = None
    value: float | None = None
    usual: tuple[float, float] | None = None

    @property
    def unusual(self) -> bool:
        """Tell whether the value lies outside of the usual range."""
        low, high = self.usual or (-np.inf, np.inf)
        return self.value is not None and not low <= self.value <= high


@dataclass(frozen=True)
class Segment:
    """Steps `first` to `last` of an episode: its mean leverage under a run, and why."""

    episode: int
    first: int
    last: int
    group: str
    source: str
    leverage: float
    causes: list[Cause]


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

    def least_trusted(self, run: Scored) -> list[Segment]:
        """Return the segments of the least leverage; of equals, the more uncertain first."""
        measure = self.windows.means(run.leverage)
        ties = -self.windows.means(run.uncertainty)
        found = self.windows.least(measure, ties, count=SHOWN, per_episode=PER_EPISODE)
        model = LeverageModel.of(self.evidence.dataset, run.name)
        return [
            self._segment(window, float(measure[window]), self._causes(model, run, window))
            for window in found
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
        return [
            Dispute(self._segment(window, float("nan"), []), means[:, window].tolist())
            for window in found
        ]

    def _segment(self, window: np.int64, leverage: float, causes: list[Cause]) -> Segment:
        place = self.windows.episode[window]
        row = self.evidence.dataset.episodes.slice(place, 1).to_pylist()[0]
        return Segment(
            episode=row["episode"],
            first=int(self.windows.start[window] - self._first[place]),
            last=int(self.windows.stop[window] - self._first[place]) - 1,
            group=self.evidence.groups[self.evidence.group[place]],
            source=row["source"] or "",
            leverage=leverage,
            causes=causes,
        )

    def _causes(self, model: LeverageModel, run: Scored, window: np.int64) -> list[Cause]:
        """Name the dimensions of the largest shares, or the parts and the oddest dimensions."""
        rows = slice(self.windows.start[window], self.windows.stop[window])
        place = self.windows.episode[window]
        inside = slice(rows.start - self._first[place], rows.stop - self._first[place])
        pairs = self._pairs(int(place))
        state = pairs.states[inside].mean(axis=0)
        shares = model.estimator.shares(pairs)
        if shares is not None:
            mean = shares[inside].mean(axis=0)
            return [self._dimension(i, state, mean[i]) for i in _largest(mean)[:CAUSES]]
        low, high = self._usual
        beyond = np.maximum(low - state, state - high) / np.maximum(high - low, 1e-9)
        odd = [i for i in _largest(beyond)[: CAUSES - 1] if beyond[i] > 0]
        return [*_parts(run, rows), *(self._dimension(i, state) for i in odd)]

    def _dimension(
        self, index: np.int64, state: NDArray[np.float32], share: np.floating | None = None
    ) -> Cause:
        low, high = self._usual[:, index]
        return Cause(
            name=self.evidence.dataset.state_names[index],
            share=None if share is None else float(share),
            value=float(state[index]),
            usual=(float(low), float(high)),
        )

    @cached_property
    def _usual(self) -> NDArray[np.float64]:
        states = self.evidence.dataset.labeled().states
        return np.quantile(states, [0.05, 0.95], axis=0).astype(np.float64)

    def _read(self, place: int) -> Pairs:
        return self.evidence.dataset.episode(
            self.evidence.dataset.episodes["episode"][place].as_py()
        )


def _parts(run: Scored, rows: slice) -> list[Cause]:
    sums = {part: float(values[rows].sum()) for part, values in run.parts.items()}
    whole = sum(sums.values())
    if not whole > 0:
        return []
    ordered = sorted(sums.items(), key=lambda item: -item[1])
    return [Cause(part, value / whole) for part, value in ordered]


def _largest(values: NDArray[np.floating]) -> NDArray[np.int64]:
    return np.argsort(-values, kind="stable")
