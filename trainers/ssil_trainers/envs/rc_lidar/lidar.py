"""Walls and the rays that end on them: a LiDAR among straight walls, exact to rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.rc_lidar import kernels as rc_kernel
from ssil_trainers.envs.rc_lidar.kernels import Grid

CELL = 0.5
"""Side of a grid cell [m]: measured fastest for tracks a metre or two wide."""
_MARGIN = 1e-3
_MOST_CELLS = 50_000_000


@dataclass(frozen=True, eq=False)
class Walls:
    """Straight walls (n, 4), each x, y of its start and x, y of its end [m], ready for rays."""

    segments: NDArray[np.float64]
    grid: Grid

    @classmethod
    def of(cls, segments: ArrayLike, *, cell: float = CELL) -> Walls:
        """Sort walls (n, 4) into a grid of cells of side `cell`.

        Raises InvalidInputError for another shape, no wall, or numbers that are not finite.
        """
        given = np.array(segments, dtype=np.float64)
        if given.ndim != 2 or given.shape[1] != 4 or not len(given):
            raise InvalidInputError(f"walls: expected shape (n, 4), found {given.shape}")
        bad = np.flatnonzero(~np.isfinite(given).all(axis=1))
        if len(bad):
            raise InvalidInputError(
                f"walls: expected finite numbers, found {given[bad[0]].tolist()} at row {bad[0]}"
            )
        if not 0 < cell < np.inf:
            raise InvalidInputError(f"cell: expected a positive length, found {cell}")
        return cls(given, _grid(given, cell))

    def scan(self, poses: ArrayLike, beams: ArrayLike, *, reach: float) -> NDArray[np.float64]:
        """Return the range [m] of every beam from every pose, (n, b), at most `reach`.

        poses (n, 3): x, y, heading; beams (b,): directions off the heading [rad], left positive.
        A pose outside of the rectangle around the walls sees none of them. Raises InvalidInputError
        for another shape, numbers that are not finite, or a reach that is not positive.
        """
        given = np.atleast_2d(_finite("poses", poses))
        if given.ndim != 2 or given.shape[1] != 3:
            raise InvalidInputError(f"poses: expected shape (n, 3), found {np.shape(poses)}")
        angles = _finite("beams", beams)
        if angles.ndim != 1:
            raise InvalidInputError(f"beams: expected shape (b,), found {angles.shape}")
        if not reach > 0:
            raise InvalidInputError(f"reach: expected a length above 0, found {reach}")
        directions = directions_of(angles)
        ranges = np.empty((len(given), len(directions)))
        rc_kernel.fans(self.grid, given, directions, float(reach), ranges)
        return ranges


def directions_of(angles: ArrayLike) -> NDArray[np.float64]:
    """Return cosine and sine (b, 2) of angles (b,) [rad], the form in which rays are cast."""
    given = np.asarray(angles, dtype=np.float64)
    return np.stack([np.cos(given), np.sin(given)], axis=1)


def _finite(name: str, values: ArrayLike) -> NDArray[np.float64]:
    try:
        given = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInputError(f"{name}: expected numbers, found {values!r}") from None
    wrong = given[~np.isfinite(given)]
    if len(wrong):
        raise InvalidInputError(f"{name}: expected finite numbers, found {wrong[0]}")
    return given


def _grid(segments: NDArray[np.float64], cell: float) -> Grid:
    corners = segments.reshape(-1, 2)
    low = corners.min(axis=0) - _MARGIN
    with np.errstate(over="ignore"):
        sides = np.ceil((corners.max(axis=0) + _MARGIN - low) / cell)
        cells = float(np.prod(sides))
    if cells > _MOST_CELLS:
        raise InvalidInputError(
            f"walls: expected at most {_MOST_CELLS:,} cells of {cell} m, found {cells:,.0f}"
        )
    shape = sides.astype(np.int64)
    first = np.zeros(int(cells) + 1, dtype=np.int64)
    empty = Grid(low, float(cell), shape, first, np.empty((0, 4)))
    rc_kernel.sort_into_cells(segments, empty, first, np.empty(0, dtype=np.int64))
    first = np.cumsum(first)
    rows = np.empty(first[-1], dtype=np.int64)
    rc_kernel.sort_into_cells(segments, empty, first[:-1].copy(), rows)
    start, end = segments[rows, :2], segments[rows, 2:]
    walls = np.ascontiguousarray(np.hstack([start, end - start]))
    return Grid(low, float(cell), shape, first, walls)
