"""Ranks of uncertainty in a pool as normal scores, which make estimators comparable."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

KNOTS = 257
"""Quantiles that a pool is remembered by."""

FARTHEST = 4.0
"""Normal scores end at ±4 deviations, the share of 1 in 30,000."""

_GRID = np.linspace(-FARTHEST, FARTHEST, KNOTS)


def find_knots(uncertainty: ArrayLike) -> NDArray[np.float32]:
    """Return the quantiles of a pool that lie evenly in normal scores.

    Parameters
    ----------
    uncertainty
        Of the pool, (n,), at least one finite number.

    Returns
    -------
    ndarray
        (`KNOTS`,) float32, not falling.

    Examples
    --------
    >>> from ssil_data.ranks import find_knots
    >>> find_knots(np.arange(1001.0))[128].item()
    500.0
    """
    from scipy.special import ndtr  # slow to import, and most commands do without

    # midpoints of ranks: the least of n values is at 1 / 2n
    pool = np.asarray(uncertainty, dtype=np.float64)
    return np.quantile(pool, ndtr(_GRID), method="hazen").astype(np.float32)


def normal_scores(uncertainty: ArrayLike, knots: ArrayLike) -> NDArray[np.float32]:
    """Return the normal score of each value in a pool: 0 for its median; larger = stranger.

    The 95 % quantile gets 1.64. A value among equal ones gets the middle of their ranks; one beyond
    the pool gets the end's.

    Parameters
    ----------
    uncertainty
        (n,), not NaN.
    knots
        Of the pool, from `find_knots`.

    Returns
    -------
    ndarray
        (n,) float32; larger = stranger.

    Examples
    --------
    >>> from ssil_data.ranks import find_knots, normal_scores
    >>> normal_scores([500.0, 950.0, 1e9], find_knots(np.arange(1001.0))).round(1).astype(str)
    array(['0.0', '1.6', '3.7'], dtype='<U32')
    """
    values = np.asarray(uncertainty, dtype=np.float32)
    grid = np.asarray(knots, dtype=np.float32)
    distinct = np.unique(grid)
    middle = (
        _GRID[np.searchsorted(grid, distinct, side="left")]
        + _GRID[np.searchsorted(grid, distinct, side="right") - 1]
    ) / 2
    return interpolate(values, distinct, middle)


def interpolate(
    values: NDArray[np.floating], places: NDArray[np.floating], heights: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Return heights by linear interpolation, in the order of the values to the last bit.

    Rounding lets `numpy.interp` end a little beyond a piece's end where places are far apart.

    Parameters
    ----------
    values
        (n,), not NaN; those beyond the first and the last place get the ends' heights.
    places
        Rising, (k,).
    heights
        At the places, (k,), all rising or all falling.
    """
    found = np.interp(values, places, heights)
    piece = np.clip(np.searchsorted(places, values, side="right"), 1, max(len(places) - 1, 1))
    ends = heights[piece - 1], heights[np.minimum(piece, len(heights) - 1)]
    return np.clip(found, np.minimum(*ends), np.maximum(*ends)).astype(np.float32)
