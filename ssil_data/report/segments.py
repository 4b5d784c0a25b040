"""Windows of consecutive steps, which of them stand out, and ranks; arrays only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

STEPS = 20
"""Steps in a window; a shorter episode is one window."""


@dataclass(frozen=True, eq=False)
class Windows:
    """All m windows that lie within one episode, in order.

    episode (m,) is the index of the episode; the window's rows among all pairs go from start (m,)
    to stop (m,), the latter not included.
    """

    episode: NDArray[np.int64]
    start: NDArray[np.int64]
    stop: NDArray[np.int64]

    def __len__(self) -> int:
        """Count the windows."""
        return len(self.start)

    def means(self, values: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return means over the windows.

        Parameters
        ----------
        values
            One value per pair, (n,).

        Returns
        -------
        NDArray
            (m,), rounded to 9 decimals so that equal windows compare equal.
        """
        sums = np.concatenate([[0.0], np.cumsum(values, dtype=np.float64)])
        means = (sums[self.stop] - sums[self.start]) / (self.stop - self.start)
        return np.round(means, 9)

    def find_least(
        self,
        measure: NDArray[np.floating],
        ties: NDArray[np.floating],
        *,
        count: int,
        per_episode: int,
    ) -> NDArray[np.int64]:
        """Find the windows of the least measure, of which none overlaps another.

        Parameters
        ----------
        measure
            One value per window, (m,).
        ties
            Orders windows of equal measure, (m,); after that, the earlier window comes first.
        count
            Windows to return, at most.
        per_episode
            Windows of one episode, at most.

        Returns
        -------
        NDArray
            Indices of windows, least measure first.
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
            # the best window of each episode; then what overlaps it is out
            best = np.minimum.reduceat(place, first)
            free = best < len(self)
            chosen.append(best[free])
            taken = np.repeat(order[np.where(free, best, 0)], sizes)
            near = (self.start < self.stop[taken]) & (self.stop > self.start[taken])
            place[near] = len(self)
        return order[np.sort(np.concatenate(chosen))[:count]]


def cut_windows(
    lengths: NDArray[np.int64], eligible: NDArray[np.bool_], *, steps: int = STEPS
) -> Windows:
    """Return all windows of some episodes.

    Parameters
    ----------
    lengths
        Steps of each episode, (e,); their rows follow each other.
    eligible
        Which episodes to cut, (e,).
    steps
        Steps in a window; a shorter episode is one window.
    """
    first = np.cumsum(lengths) - lengths
    width = np.minimum(lengths, steps)
    counts = np.where(eligible, lengths - width + 1, 0)
    episode = np.repeat(np.arange(len(lengths)), counts)
    offset = np.arange(len(episode)) - np.repeat(np.cumsum(counts) - counts, counts)
    start = first[episode] + offset
    return Windows(episode, start, start + width[episode])


def rank_among(values: NDArray[np.floating], among: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the share of some pairs whose value is smaller, ties counting half.

    Such standings make runs with different scales comparable; the correlation of the standings of
    those pairs is Spearman's.

    Parameters
    ----------
    values
        One value per pair, (n,).
    among
        The pairs to compare with, (n,).

    Returns
    -------
    NDArray
        Standings of all pairs, (n,) in [0, 1].
    """
    pool = np.sort(values[among])
    below, upto = (np.searchsorted(pool, values, side=side) for side in ("left", "right"))
    return (below + upto) / (2 * max(1, len(pool)))


def correlate_ranks(standings: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Spearman's correlation of every two runs: 1 = they rank the pairs alike.

    Parameters
    ----------
    standings
        Of each of r runs, as `rank_among` gives them of the pairs that they are among, (r, n).

    Returns
    -------
    NDArray
        (r, r), NaN for a run that is constant: it ranks nothing.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.atleast_2d(np.corrcoef(standings))
