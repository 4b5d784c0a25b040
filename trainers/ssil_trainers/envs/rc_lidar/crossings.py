"""Which straight pieces cross each other, and where."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_BLOCK = 256


def find_crossings(pieces: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return which straight pieces meet.

    Two that share an end are no crossing, unless they run back over each other; a piece without
    length meets nothing.

    Parameters
    ----------
    pieces:
        x, y of the start and x, y of the end of each piece (n, 4).

    Returns
    -------
    ndarray of int64
        Pairs of rows, the lower row first, in order (m, 2).

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.crossings import find_crossings
    >>> find_crossings(np.array([[0.0, 0, 2, 2], [5, 5, 6, 6], [0, 2, 2, 0]]))
    array([[0, 2]])
    """
    low = np.minimum(pieces[:, :2], pieces[:, 2:])
    high = np.maximum(pieces[:, :2], pieces[:, 2:])
    found = [np.empty((0, 2), dtype=np.int64)]
    for begin in range(0, len(pieces), _BLOCK):
        block = slice(begin, begin + _BLOCK)
        near = (low[block, None] <= high[None, begin:]) & (low[None, begin:] <= high[block, None])
        one, two = np.nonzero(near[..., 0] & near[..., 1])
        pairs = np.stack([one, two], axis=1)[one < two] + begin
        found.append(pairs[_meets(pieces[pairs[:, 0]], pieces[pairs[:, 1]])])
    return np.concatenate(found)


def intersect_lines(one: NDArray[np.float64], two: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the lines through two pieces cross.

    Parameters
    ----------
    one, two:
        x, y of the start and x, y of the end (4,).

    Returns
    -------
    ndarray of float64
        x, y (2,); the end of the first piece if the lines are parallel.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.crossings import intersect_lines
    >>> intersect_lines(np.array([0.0, 0, 2, 2]), np.array([0.0, 2, 2, 0]))
    array([1., 1.])
    """
    start = one[:2]
    along = one[2:] - one[:2]
    other = two[2:] - two[:2]
    across = along[0] * other[1] - along[1] * other[0]
    if across == 0:
        return one[2:]
    away = two[:2] - start
    return start + along * (away[0] * other[1] - away[1] * other[0]) / across


def _meets(one: NDArray[np.float64], two: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which pieces have a point in common that is no shared end."""
    a = one[..., :2]
    b = one[..., 2:]
    c = two[..., :2]
    d = two[..., 2:]
    turns_c = _turn(a, b, c)
    turns_d = _turn(a, b, d)
    turns_a = _turn(c, d, a)
    turns_b = _turn(c, d, b)
    across = (turns_c * turns_d < 0) & (turns_a * turns_b < 0)
    long = (a != b).any(axis=-1) & (c != d).any(axis=-1)
    touching = long & (
        ((turns_c == 0) & _strictly_between(a, b, c))
        | ((turns_d == 0) & _strictly_between(a, b, d))
        | ((turns_a == 0) & _strictly_between(c, d, a))
        | ((turns_b == 0) & _strictly_between(c, d, b))
    )
    return across | touching


def _turn(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return twice the signed area of the triangle a, b, c: positive where c is left of a → b."""
    first = b - a
    second = c - a
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def _strictly_between(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Tell whether c, which is on the line through a and b, lies between them."""
    return np.sum((c - a) * (c - b), axis=-1) < 0
