"""Windows of consecutive steps, and which of them stand out; knows arrays only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

STEPS = 20
"""Consecutive steps in a window; a shorter episode is one window."""


@dataclass(frozen=True, eq=False)
class Windows:
    """All windows that lie within one of the chosen episodes, in order.

    episode (m,) is the place of the episode, start (m,) and stop (m,) are rows of the pairs.
    """

    episode: NDArray[np.int64]
    start: NDArray[np.int64]
    stop: NDArray[np.int64]

    def __len__(self) -> int:
        """Count the windows."""
        return len(self.start)

    def means(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the mean of `values` (n,) over each window, (m,)."""
        sums = np.concatenate([[0.0], np.cumsum(values, dtype=np.float64)])
        means = (sums[self.stop] - sums[self.start]) / (self.stop - self.start)
        return np.round(means, 9)

    def least(
        self,
        measure: NDArray[np.floating],
        ties: NDArray[np.floating],
        *,
        count: int,
        per_episode: int,
    ) -> NDArray[np.int64]:
        """Return up to `count` windows of the least `measure` (m,), least first.

        None overlaps another and no episode has more than `per_episode`. Equal measures are
        ordered by `ties` (m,), then by place.
        """
        if not len(self):
            return np.zeros(0, np.int64)
        order = np.lexsort((ties, measure))
        place = np.empty(len(self), np.int64)
        place[order] = np.arange(len(self))
        first = np.flatnonzero(np.diff(self.episode, prepend=-1))
        sizes = np.diff(np.append(first, len(self)))
        chosen: list[NDArray[np.int64]] = []
        for _ in range(per_episode):
            best = np.minimum.reduceat(place, first)
            free = best < len(self)
            chosen.append(best[free])
            taken = np.repeat(order[np.where(free, best, 0)], sizes)
            near = (self.start < self.stop[taken]) & (self.stop > self.start[taken])
            place[near] = len(self)
        return order[np.sort(np.concatenate(chosen))[:count]]


def windows(
    lengths: NDArray[np.int64], eligible: NDArray[np.bool_], *, steps: int = STEPS
) -> Windows:
    """Return the windows of `steps` pairs of episodes (e,) whose rows follow each other."""
    first = np.cumsum(lengths) - lengths
    width = np.minimum(lengths, steps)
    counts = np.where(eligible, lengths - width + 1, 0)
    episode = np.repeat(np.arange(len(lengths)), counts)
    offset = np.arange(len(episode)) - np.repeat(np.cumsum(counts) - counts, counts)
    start = first[episode] + offset
    return Windows(episode, start, start + width[episode])


def rank_among(values: NDArray[np.floating], among: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the share of the pairs `among` (n,) whose value is smaller, ties half, for all (n,).

    Standings of runs with different scales can be compared, and their correlation is Spearman's.
    """
    pool = np.sort(values[among])
    below, upto = (np.searchsorted(pool, values, side=side) for side in ("left", "right"))
    return (below + upto) / (2 * max(1, len(pool)))


def correlations(standings: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the correlation of each of r rows of standings (r, n) with each, (r, r).

    NaN where a row is constant: it ranks nothing.
    """
    spread = standings - standings.mean(axis=1, keepdims=True)
    norm = np.linalg.norm(spread, axis=1)
    known = np.where(norm > 0, norm, np.nan)
    return (spread @ spread.T) / np.outer(known, known)
