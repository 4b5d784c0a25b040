"""A closed track: a center line and the widths beside it; refuses what is no track."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.rc_lidar.crossings import find_crossings, intersect_lines
from ssil_trainers.envs.rc_lidar.lidar import Walls

_OPEN = 4.0
"""A line is open whose ends are this many times farther apart than any two of its neighbors."""
_FAR = 1e9
"""Lengths [m] beyond this are no meters, and their squares would overflow."""
_SAME = 1e-3
"""The last point repeats the first if it is nearer than this share of the usual distance."""
_MITERED, _SHARPEST = np.cos(np.deg2rad([7.5, 60.0]))
"""Cosines of half the turn in a point from which walls are mitered, and of the sharpest one."""
_LOOP = 6.0
"""A wall's loop is cut off if its stretch of the center line is shorter than so many widths."""


@dataclass(frozen=True, eq=False)
class Track:
    """A closed center line and the widths beside it.

    A wall's corner stands at the width from its point, square to the line there. Where the line
    turns by more than 15° in a point, that would bring the walls nearer than the widths before and
    after it, so the corner stands farther out, where both meet; below, nearer by less than 1 %. In
    a corner tighter than the width the inner wall folds into a loop; the loop is cut off where it
    begins. What cannot be mended so is refused.

    Parameters
    ----------
    name:
        Name of the track.
    center:
        Points of the center line in driving order [m] (n, 2); the last joins the first, which is
        not repeated.
    right, left:
        Widths to the right and to the left of each point [m] (n,).

    Raises
    ------
    InvalidInputError
        With the row: for fewer than four points, numbers that are not finite, widths that are not
        positive, points that coincide, an open line, a turn of more than 120° in one point, a line
        or walls that cross.

    Examples
    --------
    A square of 9 m, one meter to either side of its line:

    >>> from ssil_trainers.envs.rc_lidar.track import Track
    >>> square = Track("square", np.array([[0, 0], [9, 0], [9, 9], [0, 9]]), np.ones(4), np.ones(4))
    >>> square.length, square.left_wall[0].round(9).tolist()
    (36.0, [1.0, 1.0])
    """

    name: str
    center: NDArray[np.float64]
    right: NDArray[np.float64]
    left: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Validate and freeze."""
        for field in ("center", "right", "left"):
            values = np.array(getattr(self, field), dtype=np.float64)
            values.flags.writeable = False
            object.__setattr__(self, field, values)
        self._check_numbers()
        self._check_line()
        self._check_walls()

    @cached_property
    def length(self) -> float:
        """Length of the center line [m]."""
        return float(np.linalg.norm(_steps(self.center), axis=1).sum())

    @cached_property
    def right_wall(self) -> NDArray[np.float64]:
        """The wall on the right (n, 2)."""
        return self._wall(-self.right)

    @cached_property
    def left_wall(self) -> NDArray[np.float64]:
        """The wall on the left (n, 2)."""
        return self._wall(self.left)

    @cached_property
    def walls(self) -> Walls:
        """Both walls, ready for rays."""
        return Walls.from_segments(
            np.concatenate([_close(self.right_wall), _close(self.left_wall)])
        )

    def sample_poses(self, spacing: float) -> NDArray[np.float64]:
        """Return places along the center line at even distances.

        Parameters
        ----------
        spacing:
            About how far they are apart [m]; the line is divided evenly.

        Returns
        -------
        ndarray of float64
            x, y [m] and heading [rad] (m, 3).
        """
        steps = _steps(self.center)
        at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
        along = np.linspace(0.0, self.length, max(1, round(self.length / spacing)), endpoint=False)
        looped = np.concatenate([self.center, self.center[:1]])
        x, y = (np.interp(along, at, looped[:, axis]) for axis in (0, 1))
        tangent_x, tangent_y = (
            np.interp(along, at, np.append(self._tangents[:, axis], self._tangents[0, axis]))
            for axis in (0, 1)
        )
        return np.stack([x, y, np.arctan2(tangent_y, tangent_x)], axis=1)

    @cached_property
    def _bisectors(self) -> NDArray[np.float64]:
        """Sums (n, 2) of the unit vectors to and from each point."""
        ahead = _steps(self.center)
        ahead = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
        return ahead + np.roll(ahead, 1, axis=0)

    @property
    def _tangents(self) -> NDArray[np.float64]:
        """Unit vectors (n, 2) along the line, in each point between its two sides' directions."""
        return self._bisectors / np.linalg.norm(self._bisectors, axis=1, keepdims=True)

    @property
    def _cos_half_turn(self) -> NDArray[np.float64]:
        """Cosine (n,) of half the angle by which the line turns in each point."""
        return np.linalg.norm(self._bisectors, axis=1) / 2

    def _wall(self, aside: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the line so far to the left (n,) of the center line, its loops cut off."""
        normals = np.stack([-self._tangents[:, 1], self._tangents[:, 0]], axis=1)
        sharp = self._cos_half_turn < _MITERED
        normals[sharp] /= self._cos_half_turn[sharp, None]
        wall = self.center + normals * aside[:, None]
        along = _steps(self.center)
        backwards = np.sum(_steps(wall) * along, axis=1) < 0
        gaps = np.linalg.norm(along, axis=1)
        loops = [
            (stretch, first, last)
            for first, last in _either_way(find_crossings(_close(wall)))
            if backwards[_rows(first, last, len(wall))].any()
            and (stretch := gaps[_rows(first, last, len(wall))].sum()) < _LOOP * abs(aside[first])
        ]
        for _, first, last in sorted(loops, reverse=True):
            pieces = _close(wall)
            inside = _rows(first, last, len(wall))[1:]
            if len(inside) and (wall[inside] != wall[inside[0]]).any():
                wall[inside] = intersect_lines(pieces[first], pieces[last])
        return wall

    def _check_numbers(self) -> None:
        """Refuse shapes, widths and points that are no numbers of a track."""
        points = len(self.center)
        if self.center.ndim != 2 or self.center.shape[1] != 2 or points < 4:
            raise self._refusal(
                points, "at least four points x, y", f"the shape {self.center.shape}"
            )
        for side in ("right", "left"):
            width = getattr(self, side)
            if width.shape != (points,):
                raise InvalidInputError(
                    f"track {self.name}: expected {points} widths on the {side}, "
                    f"found shape {width.shape}"
                )
            for row in np.flatnonzero(~(np.isfinite(width) & (width > 0))):
                raise self._refusal(row, f"a positive width on the {side}", f"{width[row]}")
            for row in np.flatnonzero(width > _FAR):
                raise self._refusal(row, f"a width on the {side} in meters", f"{width[row]:g}")
        for row in np.flatnonzero(~(np.abs(self.center) < _FAR).all(axis=1)):
            raise self._refusal(row, "finite x, y in meters", f"{self.center[row].tolist()}")

    def _check_line(self) -> None:
        """Refuse a line that is open, repeats a point, turns too sharply or crosses itself."""
        gaps = np.linalg.norm(_steps(self.center), axis=1)
        last = len(gaps) - 1
        if gaps[last] < _SAME * np.median(gaps):
            raise self._refusal(last, "a last point that is not the first", "the first again")
        for row in np.flatnonzero(gaps[:-1] < 1e-9) + 1:
            raise self._refusal(row, "another point than the one before", "the same")
        if gaps[last] > _OPEN * gaps[:-1].max():
            raise self._refusal(
                last,
                f"a closed line, whose last point is near the first (at most {_OPEN:g} times "
                f"{gaps[:-1].max():.3g} m)",
                f"{gaps[last]:.3g} m between them",
            )
        for row, other in find_crossings(_close(self.center)):
            raise self._refusal(row, "a line that does not cross itself", f"row {other} across it")

        for row in np.flatnonzero(self._cos_half_turn < _SHARPEST - 1e-9):
            turn = 2 * np.rad2deg(np.arccos(self._cos_half_turn[row]))
            raise self._refusal(row, "a turn of at most 120° in one point", f"{turn:.0f}°")

    def _check_walls(self) -> None:
        """Refuse widths that leave no wall, a corner too tight for them, and walls that cross."""
        along = _steps(self.center)
        for side, wall in (("right", self.right_wall), ("left", self.left_wall)):
            if len(np.unique(wall, axis=0)) < len(wall) / 2:  # its loops swallowed it
                width = getattr(self, side)
                row = int(width.argmax())
                expected = f"widths that leave a wall on the {side}"
                raise self._refusal(row, expected, f"{width[row]:g} m")
        for side, wall in (("right", self.right_wall), ("left", self.left_wall)):
            progress = np.sum(_steps(wall) * along, axis=1)
            for row in np.flatnonzero(progress < -1e-9 * np.sum(along**2, axis=1)):
                raise self._refusal(
                    row,
                    f"a corner wide enough for {getattr(self, side)[row]:.3g} m on the {side}",
                    "a tighter one",
                )
        points = len(self.center)
        walls = np.concatenate([_close(self.right_wall), _close(self.left_wall)])
        for row, other in find_crossings(walls) % points:
            raise self._refusal(
                row, "walls that do not cross", f"the wall of row {other} across that of this row"
            )

    def _refusal(self, row: Any, expected: str, found: str) -> InvalidInputError:
        """Return the error about a row."""
        return InvalidInputError(
            f"track {self.name}, row {row}: expected {expected}, found {found}"
        )


def load_track(path: Path | str) -> Track:
    r"""Read a track from a CSV file of F1TENTH's form.

    Its columns are x_m, y_m, w_tr_right_m, w_tr_left_m; comments begin with `#`.

    Parameters
    ----------
    path:
        The file, whose name is the track's.

    Returns
    -------
    Track
        The track.

    Raises
    ------
    InvalidInputError
        For a file that holds no track, naming it and the row, counted from 0 without comments and
        blank lines.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from ssil_trainers.envs.rc_lidar.track import load_track
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "square.csv")
    ...     _ = file.write_text("0,0,1,1\n9,0,1,1\n9,9,1,1\n0,9,1,1\n")
    ...     square = load_track(file)
    >>> square.name, square.length
    ('square', 36.0)
    """
    path = Path(path)
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"track {path}: cannot read the CSV file: {error}") from None
    texts = [line for line in map(str.strip, lines) if line and not line.startswith("#")]
    rows = [_numbers(path, row, text) for row, text in enumerate(texts)]
    values = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return Track(path.stem, values[:, :2], values[:, 2], values[:, 3])


def save_track(track: Track, path: Path | str) -> None:
    """Write a track as a CSV file that `load_track` reads back, number by number.

    Parameters
    ----------
    track:
        The track.
    path:
        The file to write.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from ssil_trainers.envs.rc_lidar.track import load_track, save_track
    >>> from ssil_trainers.envs.rc_lidar.tracks import find_track
    >>> hall = find_track("hall")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_track(hall, Path(folder, "copy.csv"))
    ...     copy = load_track(Path(folder, "copy.csv"))
    >>> bool((copy.center == hall.center).all())
    True
    """
    rows = np.column_stack([track.center, track.right, track.left]).tolist()
    lines = ["# x_m, y_m, w_tr_right_m, w_tr_left_m", *(", ".join(map(repr, row)) for row in rows)]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _numbers(path: Path, row: int, text: str) -> list[float]:
    """Return the four numbers of a row; raises InvalidInputError that names it."""
    try:
        # Python reads 1_0 as 10; a file that has it means something else.
        values = [] if "_" in text else [float(cell) for cell in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 4:
        raise InvalidInputError(
            f"track {path}, row {row}: expected four numbers x, y, right, left, found {text!r}"
        )
    return values


def _steps(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vector from every point of a closed line to the next."""
    return np.roll(points, -1, axis=0) - points


def _close(points: ArrayLike) -> NDArray[np.float64]:
    """Return the sides (n, 4) of a closed line."""
    points = np.asarray(points, dtype=np.float64)
    return np.hstack([points, np.roll(points, -1, axis=0)])


def _either_way(pairs: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """Yield each pair of rows of a closed line as the stretch between them and as the rest."""
    for first, last in pairs.tolist():
        yield first, last
        yield last, first


def _rows(first: int, last: int, points: int) -> NDArray[np.int64]:
    """Return the rows from first to last of a closed line."""
    return np.arange(first, last + 1 + (points if last < first else 0)) % points
