"""Walls and the rays that end on them: a LiDAR among straight walls, exact to rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.rc_lidar import kernels
from ssil_trainers.envs.rc_lidar.kernels import Beams, Grid

CELL = 0.5
"""Side of a grid cell [m]: measured fastest for tracks a metre or two wide."""
_MARGIN = 1e-3
_MOST_CELLS = 50_000_000


@dataclass(frozen=True, eq=False)
class Walls:
    """Straight walls, sorted into a grid so that rays find them quickly.

    Parameters
    ----------
    segments:
        x, y of the start and x, y of the end of each wall [m] (n, 4).
    grid:
        The same walls, by cell.

    Examples
    --------
    A room of 4 by 3 m, seen from (1, 1) to the right, ahead and to the left:

    >>> from ssil_trainers.envs.rc_lidar.lidar import Walls
    >>> room = Walls.from_segments([[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]])
    >>> room.scan([1, 1, 0], np.deg2rad([-90, 0, 90]), reach=10)
    array([[1., 3., 2.]])
    """

    segments: NDArray[np.float64]
    grid: Grid

    @classmethod
    def from_segments(cls, segments: ArrayLike, *, cell: float = CELL) -> Walls:
        """Sort walls into a grid of cells.

        Parameters
        ----------
        segments:
            x, y of the start and x, y of the end of each wall [m] (n, 4).
        cell:
            Side of a cell [m]; it changes the speed, not the ranges.

        Returns
        -------
        Walls
            Ready for `scan`.

        Raises
        ------
        InvalidInputError
            For another shape, no wall, numbers that are not finite, or more than 50 million cells.
        """
        values = np.array(segments, dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != 4 or not len(values):
            raise InvalidInputError(f"walls: expected shape (n, 4), found {values.shape}")
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise InvalidInputError(
                f"walls: expected finite numbers, found {values[bad[0]].tolist()} at row {bad[0]}"
            )
        if not 0 < cell < np.inf:
            raise InvalidInputError(f"cell: expected a positive length, found {cell}")
        return cls(values, _build_grid(values, cell))

    def scan(self, poses: ArrayLike, beams: ArrayLike, *, reach: float) -> NDArray[np.float64]:
        """Return the range of every beam from every pose.

        A pose outside of the rectangle around the walls sees none of them.

        Parameters
        ----------
        poses:
            x, y [m] and heading [rad] (n, 3).
        beams:
            Directions off the heading, left positive [rad] (b,).
        reach:
            Greatest range [m].

        Returns
        -------
        ndarray of float64
            Ranges [m], at most `reach` (n, b).

        Raises
        ------
        InvalidInputError
            For another shape, numbers that are not finite, or a reach that is not positive.
        """
        places = np.atleast_2d(_finite("poses", poses))
        if places.ndim != 2 or places.shape[1] != 3:
            raise InvalidInputError(f"poses: expected shape (n, 3), found {np.shape(poses)}")
        angles = _finite("beams", beams)
        if angles.ndim != 1:
            raise InvalidInputError(f"beams: expected shape (b,), found {angles.shape}")
        if not reach > 0:
            raise InvalidInputError(f"reach: expected a length above 0, found {reach}")
        ranges = np.empty((len(places), len(angles)))
        kernels.scan_poses(self.grid, places, Beams(unit_vectors(angles), float(reach)), ranges)
        return ranges


def unit_vectors(angles: ArrayLike) -> NDArray[np.float64]:
    """Return cosine and sine of angles, the form in which rays are cast.

    Parameters
    ----------
    angles:
        Angles [rad] (b,).

    Returns
    -------
    ndarray of float64
        Unit vectors (b, 2).

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.lidar import unit_vectors
    >>> unit_vectors([0.0, np.pi / 6]).round(3)
    array([[1.   , 0.   ],
           [0.866, 0.5  ]])
    """
    values = np.asarray(angles, dtype=np.float64)
    return np.stack([np.cos(values), np.sin(values)], axis=1)


def _finite(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return finite numbers as an array; raises InvalidInputError that names them."""
    try:
        numbers = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInputError(f"{name}: expected numbers, found {values!r}") from None
    wrong = numbers[~np.isfinite(numbers)]
    if len(wrong):
        raise InvalidInputError(f"{name}: expected finite numbers, found {wrong[0]}")
    return numbers


def _build_grid(segments: NDArray[np.float64], cell: float) -> Grid:
    """Sort walls (n, 4) into cells by counting, listing and copying."""
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
    kernels.sort_into_cells(segments, empty, first, np.empty(0, dtype=np.int64))
    first = np.cumsum(first)
    rows = np.empty(first[-1], dtype=np.int64)
    kernels.sort_into_cells(segments, empty, first[:-1].copy(), rows)
    start = segments[rows, :2]
    end = segments[rows, 2:]
    walls = np.ascontiguousarray(np.hstack([start, end - start]))
    return Grid(low, float(cell), shape, first, walls)
