"""Why a segment has low leverage: parts of its uncertainty, and unusual state dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs, join_pairs
from ssil_data.report.evidence import ScoredRun
from ssil_data.scoring import LeverageModel
from ssil_data.store.dataset import Dataset

DIMENSIONS = 3
"""State dimensions in a reason, at most."""


@dataclass(frozen=True)
class Dimension:
    """A state dimension in a reason.

    share is its share of the uncertainty, None where the estimator has no such shares. value is the
    mean over the segment, and usual the range of 90 % of the labeled pairs, if there are any; both
    in the dataset's units.
    """

    name: str
    share: float | None
    value: float
    usual: tuple[float, float] | None

    @property
    def unusual(self) -> bool:
        """Whether the value lies outside of the usual range."""
        return self.usual is not None and not self.usual[0] <= self.value <= self.usual[1]


@dataclass(frozen=True)
class Reason:
    """Shares of the uncertainty by the name of its part, and the state dimensions to look at."""

    parts: dict[str, float]
    dimensions: list[Dimension]


class Reasons:
    """Finds the reasons of segments, given the states of their episodes and the labeled range.

    Parameters
    ----------
    dataset
        The dataset; it is read in one pass.
    episodes
        Numbers of the episodes whose segments are to be explained.
    """

    def __init__(self, dataset: Dataset, episodes: Sequence[int]) -> None:
        self._names = dataset.state_names
        self._pairs = _read_pairs(dataset, episodes)
        self._usual = _usual(dataset)

    def explain(
        self, model: LeverageModel, run: ScoredRun, rows: slice, *, episode: int, first: int
    ) -> Reason:
        """Return why a run gives a segment its uncertainty.

        These are the state dimensions with the largest shares; or, where the estimator has no
        shares of dimensions, the parts of its uncertainty and the dimensions that lie furthest
        beyond the labeled pairs' range.

        Parameters
        ----------
        model
            The run's estimator and scale.
        run
            The run.
        rows
            Rows of the segment among all pairs.
        episode
            Number of its episode.
        first
            Step of the episode at which it begins.
        """
        pairs = self._pairs[episode]
        inside = slice(first, first + rows.stop - rows.start)
        state = pairs.states[inside].mean(axis=0)
        shares = model.estimator.shares(pairs)
        if shares is not None:
            mean = shares[inside].mean(axis=0)
            largest = np.argsort(-mean, kind="stable")[:DIMENSIONS]
            return Reason({}, [self._dimension(i, state, float(mean[i])) for i in largest])
        return Reason(
            _parts(run, rows), [self._dimension(i, state) for i in self._find_unusual(state)]
        )

    def _find_unusual(self, state: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return the dimensions furthest beyond the labeled range, in widths of that range."""
        if self._usual is None:
            return np.zeros(0, np.int64)
        low, high = self._usual
        width = np.where(high > low, high - low, 1)
        beyond = np.maximum(low - state, state - high) / width
        furthest = np.argsort(-beyond, kind="stable")[: DIMENSIONS - 1]
        return furthest[beyond[furthest] > 0]

    def _dimension(
        self, index: np.int64, state: NDArray[np.float32], share: float | None = None
    ) -> Dimension:
        usual = None
        if self._usual is not None:
            usual = float(self._usual[0, index]), float(self._usual[1, index])
        return Dimension(self._names[index], share, float(state[index]), usual)


def _read_pairs(dataset: Dataset, episodes: Sequence[int]) -> dict[int, Pairs]:
    parts: dict[int, list[Pairs]] = {episode: [] for episode in episodes}
    for batch in dataset.batches():
        for episode in np.intersect1d(batch.episode, episodes).tolist():
            parts[episode].append(batch.where(batch.episode == episode))
    return {episode: join_pairs(found) for episode, found in parts.items()}


def _usual(dataset: Dataset) -> NDArray[np.float64] | None:
    """Return the 5 % and 95 % quantiles of the labeled states, (2, d), if there are any."""
    if not any(dataset.episodes["labeled"].to_pylist()):
        return None
    return np.quantile(dataset.labeled().states.astype(np.float64), [0.05, 0.95], axis=0)


def _parts(run: ScoredRun, rows: slice) -> dict[str, float]:
    """Return the shares of the parts of the uncertainty over a segment, the largest first."""
    sums = {part: float(values[rows].sum()) for part, values in run.parts.items()}
    whole = sum(sums.values())
    ordered = sorted(sums.items(), key=lambda item: -item[1])
    return {part: value / whole for part, value in ordered} if whole > 0 else {}
