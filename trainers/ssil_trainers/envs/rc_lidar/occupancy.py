"""Occupancy maps of ROS's map server, an image beside a YAML file, as walls for rays."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, UnidentifiedImageError

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.rc_lidar.lidar import Walls

_CELL = 0.15
"""Side of a grid cell [m]: finer than for tracks, as outlines have many short pieces."""


def load_map(path: Path | str) -> Walls:
    r"""Read a map's YAML file and its image; walls outline the occupied pixels.

    A pixel is occupied where its darkness (lightness, if `negate`) exceeds `occupied_thresh`; what
    is merely unknown stops no ray.

    Parameters
    ----------
    path:
        The YAML file, whose `image` lies beside it.

    Returns
    -------
    Walls
        Ready for `scan`, in meters.

    Raises
    ------
    InvalidInputError
        For a file that is no such map, naming the file and the key.

    Examples
    --------
    A map of 3 by 3 pixels of 1 m, with one obstacle in the middle:

    >>> import tempfile
    >>> from pathlib import Path
    >>> from PIL import Image
    >>> from ssil_trainers.envs.rc_lidar.occupancy import load_map
    >>> pixels = np.full((3, 3), 255, dtype=np.uint8)
    >>> pixels[1, 1] = 0
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     Image.fromarray(pixels).save(Path(folder, "room.png"))
    ...     _ = Path(folder, "room.yaml").write_text(
    ...         "image: room.png\nresolution: 1.0\norigin: [0, 0, 0]\n"
    ...         "negate: 0\noccupied_thresh: 0.65\n"
    ...     )
    ...     walls = load_map(Path(folder, "room.yaml"))
    >>> walls.segments.min().item(), walls.segments.max().item()
    (1.25, 1.75)
    """
    path = Path(path)
    keys = _keys(path)
    resolution = _number(path, keys, "resolution")
    if not 0 < resolution < np.inf:
        raise InvalidInputError(f"{path}: expected a positive resolution, found {resolution}")
    origin = np.asarray(keys["origin"], dtype=float)
    if origin.shape != (3,) or not np.isfinite(origin).all() or origin[2] != 0:
        raise InvalidInputError(
            f"{path}: expected an origin of x, y and angle 0, found {keys['origin']}"
        )
    image = path.parent / str(keys["image"])
    try:
        with Image.open(image) as opened:
            lightness = np.asarray(opened.convert("L"), dtype=float) / 255.0
    except (OSError, UnidentifiedImageError) as error:
        raise InvalidInputError(f"{image}: cannot read the map's image: {error}") from None
    darkness = lightness if _number(path, keys, "negate") else 1.0 - lightness
    occupied = darkness > _number(path, keys, "occupied_thresh")
    return outline_pixels(occupied[::-1], resolution=resolution, origin=(origin[0], origin[1]))


def outline_pixels(occupied: ArrayLike, *, resolution: float, origin: tuple[float, float]) -> Walls:
    """Return the outlines of occupied pixels as walls.

    The obstacle was seen somewhere inside the pixel, so an outline runs halfway between the
    pixel's border and its middle; diagonal neighbors are joined, no ray slips between them.

    Parameters
    ----------
    occupied:
        Booleans (rows, columns), row 0 lowest.
    resolution:
        Side of a pixel [m].
    origin:
        x, y of the lowest, leftmost corner [m].

    Returns
    -------
    Walls
        Ready for `scan`, in meters.

    Raises
    ------
    InvalidInputError
        If nothing is occupied.

    Examples
    --------
    One pixel of 1 m at (0, 0), seen from the left: its outline is a quarter inside the border.

    >>> from ssil_trainers.envs.rc_lidar.occupancy import outline_pixels
    >>> walls = outline_pixels([[True, False], [False, True]], resolution=1.0, origin=(0.0, 0.0))
    >>> walls.scan([1.5, 0.5, np.pi], [0.0], reach=9).item()
    0.75
    """
    pixels = np.pad(np.asarray(occupied, dtype=bool), 1)
    if not pixels.any():
        raise InvalidInputError("map: no pixel is occupied, so there are no walls")
    quarters = _without_rim(np.repeat(np.repeat(pixels, 4, axis=0), 4, axis=1))
    outlines = np.concatenate([_borders(quarters), _borders(quarters.T)[:, [1, 0, 3, 2]]]) / 4
    lines = np.concatenate([outlines, *_slants(pixels)]) - 1.0
    return Walls.from_segments(lines * resolution + [*origin, *origin], cell=max(_CELL, resolution))


def _without_rim(pixels: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the occupied pixels whose eight neighbors are occupied; the rim is kept."""
    kept = pixels.copy()
    kept[1:-1] &= pixels[2:] & pixels[:-2]
    columns = kept.copy()
    kept[:, 1:-1] &= columns[:, 2:] & columns[:, :-2]
    return kept


def _borders(pixels: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the level borders between unlike rows, neighbors joined: x, y, x, y in pixels."""
    differs = (pixels[1:] != pixels[:-1]).astype(np.int8)
    edges = np.diff(differs, axis=1, prepend=0, append=0)
    row, start = np.nonzero(edges == 1)
    _, end = np.nonzero(edges == -1)
    return np.stack([start, row + 1, end, row + 1], axis=1).astype(float)


def _slants(pixels: NDArray[np.bool_]) -> Iterator[NDArray[np.float64]]:
    """Yield the lines between the middles of diagonal neighbors that no third pixel joins."""
    here = pixels[:, :-1]
    right = pixels[:, 1:]
    for low, high, other_low, other_high, slope in (
        (here[:-1], right[1:], right[:-1], here[1:], 1),
        (right[:-1], here[1:], here[:-1], right[1:], -1),
    ):
        row, column = np.nonzero(low & high & ~other_low & ~other_high)
        rises = slope > 0
        ends = [column, row + (not rises), column + 1, row + rises]
        yield np.stack(ends, axis=1).astype(np.float64) + 0.5


def _keys(path: Path) -> dict[str, Any]:
    """Read the few keys of a map file, which has no more YAML in it than `key: value`."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"{path}: cannot read the map's YAML file: {error}") from None
    found = dict(line.split(":", 1) for line in lines if ":" in line and line[0] != "#")
    keys = {key.strip(): text.strip() for key, text in found.items()}
    missing = {"image", "resolution", "origin", "negate", "occupied_thresh"} - set(keys)
    if missing:
        raise InvalidInputError(f"{path}: the keys {sorted(missing)} are missing")
    return {key: _value(text) for key, text in keys.items()}


def _value(text: str) -> Any:
    """Return the number or list that a text spells, else the text."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text


def _number(path: Path, keys: dict[str, Any], key: str) -> float:
    """Return the number of a key; raises InvalidInputError if it has none."""
    if not isinstance(keys[key], int | float):
        raise InvalidInputError(f"{path}: expected a number for {key}, found {keys[key]!r}")
    return float(keys[key])
