"""The tracks that come with the package: a family of closed curves by seed, and six by name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError, NotFoundError
from ssil_trainers.envs.rc_lidar.track import Track, load_track

LAP = 160.0
"""Length [m] of every track's center line: 400 decisions at 4 m/s and 10 Hz."""
_FINE = 0.05
"""Distance [m] of points while a line is made."""
_SPACING = 0.2
"""Distance [m] of points of the line that is kept."""
_SOFT = 0.4
"""Distance [m] over which the curvature of a line is smoothed."""
_ATTEMPTS = 200
"""Polygons that are tried before a shape is given up."""


@dataclass(frozen=True)
class Shape:
    """A member of the family of closed curves.

    Parameters
    ----------
    seed:
        The same seed gives the same track.
    corners:
        Corners of the polygon that is rounded.
    rough:
        How far corners are pulled towards the middle, from 0 (a round track) to below 1.
    tightest:
        Smallest radius of the center line [m].
    width:
        Width of the track [m].

    Raises
    ------
    InvalidInputError
        For numbers that no curve has.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.tracks import Shape, generate_track
    >>> round(generate_track(Shape(seed=7)).length)
    160
    """

    seed: int
    corners: int = 14
    rough: float = 0.6
    tightest: float = 1.4
    width: float = 1.1

    def __post_init__(self) -> None:
        """Refuse numbers that no curve has."""
        if self.seed < 0:
            raise InvalidInputError(f"seed: expected at least 0, found {self.seed}")
        if self.corners < 3:
            raise InvalidInputError(f"corners: expected at least 3, found {self.corners}")
        if not 0 <= self.rough < 1:
            raise InvalidInputError(f"rough: expected from 0 to below 1, found {self.rough}")
        if not 0 < self.width < 2 * self.tightest < LAP / 4:
            raise InvalidInputError(
                f"width: expected less than twice the tightest radius {self.tightest} m and that "
                f"less than {LAP / 4} m, found {self.width}"
            )


NAMED = {
    "yard": Shape(seed=1, corners=12, rough=0.5, tightest=1.8),
    "hall": Shape(seed=3, corners=16, rough=0.6, tightest=1.35),
    "attic": Shape(seed=4, corners=14, rough=0.7, tightest=1.3),
    "cellar": Shape(seed=5, corners=18, rough=0.6, tightest=1.3),
    "garage": Shape(seed=2, corners=16, rough=0.6, tightest=1.3),
    "loft": Shape(seed=6, corners=12, rough=0.5, tightest=1.3),
}
COLLECTION_TRACK = "yard"
"""Where demonstrations are collected; no policy is trained or tested here."""
TRAINING_TRACK = "hall"
"""Where policies are trained."""
TEST_TRACKS = ("attic", "cellar", "garage", "loft")
"""Where policies are tested, which they have never seen."""


def find_track(name: str) -> Track:
    """Return a track by its name.

    Parameters
    ----------
    name:
        One of `NAMED`, `seed-N`, or a CSV file (`….csv`).

    Returns
    -------
    Track
        The track.

    Raises
    ------
    NotFoundError
        For another name.
    InvalidInputError
        For a file that holds no track.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.tracks import find_track
    >>> find_track("hall").name
    'hall'
    """
    if name.endswith(".csv"):
        return load_track(Path(name))
    if name in NAMED:
        return generate_track(NAMED[name], name)
    seed = name.removeprefix("seed-")
    if seed != name and seed.isdecimal():
        return generate_track(Shape(int(seed)))
    raise NotFoundError(
        f"track: expected one of {', '.join(NAMED)}, seed-N or a .csv file, found {name!r}"
    )


def generate_track(shape: Shape, name: str | None = None) -> Track:
    """Return the track of a shape: a random polygon with round corners, `LAP` meters around.

    Parameters
    ----------
    shape:
        The shape; the same shape gives the same track.
    name:
        Name of the track; None is `seed-N`.

    Returns
    -------
    Track
        The track.

    Raises
    ------
    NotFoundError
        If 200 polygons all leave no room for their corners or the width.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.tracks import Shape, generate_track
    >>> generate_track(Shape(seed=7)).name
    'seed-7'
    """
    rng = np.random.default_rng([shape.seed, shape.corners])
    for _ in range(_ATTEMPTS):
        line = _round_corners(
            _polygon(shape, rng), shape.tightest * rng.uniform(1.0, 3.0, shape.corners)
        )
        if line is None:
            continue
        line = line * (LAP / _around(line))
        half = np.full(len(line), shape.width / 2)
        try:
            return Track(
                name or f"seed-{shape.seed}", np.stack([line.real, line.imag], axis=1), half, half
            )
        except InvalidInputError:
            continue
    raise NotFoundError(
        f"track: no closed curve of {shape} after {_ATTEMPTS} attempts; "
        "take fewer corners or a smaller width"
    )


def _polygon(shape: Shape, rng: np.random.Generator) -> NDArray[np.complex128]:
    """Return the corners of a star-shaped polygon, `LAP` meters around, as complex numbers."""
    jitter = rng.uniform(-0.3, 0.3, shape.corners)
    angles = 2 * np.pi * (np.arange(shape.corners) + jitter) / shape.corners
    corners = (1 - shape.rough * rng.uniform(size=shape.corners)) * np.exp(1j * angles)
    corners = corners.real * rng.uniform(1.0, 1.6) + 1j * corners.imag
    return corners * (LAP / _around(corners))


def _round_corners(
    corners: NDArray[np.complex128], radii: NDArray[np.float64]
) -> NDArray[np.complex128] | None:
    """Return the polygon with arcs of those radii for corners, at even distances; None if they do
    not fit. It is no longer than the polygon, so scaling it to that length keeps radii from below.
    """
    after = np.roll(corners, -1) - corners
    before = np.roll(after, 1)
    turns = np.angle(after / before)
    cut = radii * np.tan(np.abs(turns) / 2)
    if (cut + np.roll(cut, -1) > np.abs(after)).any():
        return None
    pieces = []
    for corner, way, turn, radius, short in zip(
        corners, before / np.abs(before), turns, radii, cut, strict=True
    ):
        side = 1j * np.sign(turn)
        swept = np.linspace(0.0, turn, max(2, round(abs(turn) * radius / _FINE)))
        middle = corner - way * short + way * side * radius
        pieces.append(middle - way * side * radius * np.exp(1j * swept))
    line = np.concatenate(pieces)
    return _even(_blur(_even(line, round(_around(line) / _FINE))), round(LAP / _SPACING))


def _blur(line: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the even line blurred over `_SOFT` meters, so that curvature does not jump."""
    frequency = np.fft.fftfreq(len(line), _around(line) / len(line))
    return np.fft.ifft(np.fft.fft(line) * np.exp(-0.5 * (2 * np.pi * _SOFT * frequency) ** 2))


def _even(line: NDArray[np.complex128], points: int) -> NDArray[np.complex128]:
    """Return `points` points of a closed line at even distances."""
    closed = np.append(line, line[0])
    at = np.append(0.0, np.cumsum(np.abs(np.diff(closed))))
    return np.interp(np.linspace(0.0, at[-1], points, endpoint=False), at, closed)


def _around(line: NDArray[np.complex128]) -> float:
    """Return the length of a closed line."""
    return float(np.abs(np.roll(line, -1) - line).sum())
