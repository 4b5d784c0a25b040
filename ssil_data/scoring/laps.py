"""How many laps of a closed road some pairs cover, where positions were recorded."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

CLOSE = 0.03
"""A lap ends this near to its start, as a share of the road's extent."""


def count_laps(
    positions: NDArray[np.float32] | None,
    episode: NDArray[np.int64],
    labeled: NDArray[np.bool_],
) -> float | None:
    """Return how many laps the labeled pairs cover; None where no lap is known.

    The lap is the shortest way on which some episode comes back to where it began, after it was
    farther from there than a third of the road's extent.

    Parameters
    ----------
    positions
        Of all pairs, (n, 2) in meters; None for none.
    episode
        Number of each pair's episode, (n,).
    labeled
        Which pairs are labeled, (n,).
    """
    if positions is None or not len(positions):
        return None
    where = positions.astype(np.float64)
    starts = np.ones(len(where), dtype=bool)
    starts[1:] = episode[1:] != episode[:-1]
    steps = np.zeros(len(where))
    steps[1:] = np.linalg.norm(np.diff(where, axis=0), axis=1)
    steps[starts] = 0
    extent = float(np.linalg.norm(np.ptp(where, axis=0)))
    bounds = [*np.flatnonzero(starts).tolist(), len(where)]
    laps = [
        _find_lap(where[first:stop], steps[first:stop], extent) for first, stop in pairwise(bounds)
    ]
    known = [lap for lap in laps if lap]
    return float(steps[labeled].sum() / np.median(known)) if known else None


def _find_lap(
    where: NDArray[np.float64], steps: NDArray[np.float64], extent: float
) -> float | None:
    """Return the way on which one episode comes back to its start; None if it does not."""
    distance = np.linalg.norm(where - where[0], axis=1)
    away = np.flatnonzero(distance > extent / 3)
    if not len(away) or not extent:
        return None
    back = np.flatnonzero(distance[away[0] :] < CLOSE * extent)
    if not len(back):
        return None
    first = away[0] + back[0]
    nearest = first + int(distance[first : first + 20].argmin())
    return float(steps[: nearest + 1].sum())
