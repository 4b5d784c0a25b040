"""One LiDAR scan of 19 beams: our rays, and those of f1tenth_gym where its file is at hand.

f1tenth_gym is not installed with this project. Its ray caster is one file, `laser_models.py`; set
SSIL_F1TENTH_LASER_MODELS to where it lies, and it is timed beside ours. Both see the same track,
drawn as a map of 5 cm pixels for it, and scan from the same poses, one call for each scan.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ssil_trainers.envs.rc_lidar import kernels
from ssil_trainers.envs.rc_lidar.lidar import unit_vectors
from ssil_trainers.envs.rc_lidar.occupancy import load_map
from ssil_trainers.envs.rc_lidar.track import Track
from ssil_trainers.envs.rc_lidar.tracks import TRAINING_TRACK, find_track

BEAMS = np.linspace(-np.pi / 2, np.pi / 2, 19)
REACH = 10.0
PIXEL = 0.05
RIM = 2.0
"""Longest range, width of a pixel and margin around the walls, in meters."""
_WALLS = find_track(TRAINING_TRACK).walls

Scan = Callable[[NDArray[np.float64]], object]
"""From one pose (3,) to its 19 ranges."""


def draw_poses(count: int = 2_000) -> NDArray[np.float64]:
    """Return poses near the middle of the training track."""
    rng = np.random.default_rng(0)
    places = find_track(TRAINING_TRACK).sample_poses(0.05)
    chosen = places[rng.integers(len(places), size=count)]
    return chosen + rng.normal(scale=[0.1, 0.1, 0.1], size=(count, 3))


def find_scanners() -> dict[str, Scan]:
    """Return every way to scan by name; f1tenth_gym's only where its file is at hand."""
    track = find_track(TRAINING_TRACK)
    with tempfile.TemporaryDirectory() as folder:
        drawn = draw_map(track, Path(folder))
        found = {
            "our rays, center line": _ours(track.walls.grid),
            "our rays, map": _ours(load_map(drawn).grid),
        }
        place = os.environ.get("SSIL_F1TENTH_LASER_MODELS")
        if place:
            found["f1tenth_gym, map"] = _theirs(Path(place), drawn)
    return found


def scan_many(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the ranges (n, 19) from poses (n, 3) on the training track, by one call."""
    return _WALLS.scan(places, BEAMS, reach=REACH)


def draw_map(track: Track, folder: Path) -> Path:
    """Draw the track as an occupancy map; return its YAML file."""
    walls = np.concatenate([track.left_wall, track.right_wall])
    low = walls.min(axis=0) - RIM
    high = walls.max(axis=0) + RIM
    width, height = (int(side) for side in np.ceil((high - low) / PIXEL))
    image = Image.new("L", (width, height), 255)
    for wall in (track.left_wall, track.right_wall):
        pixels = (np.concatenate([wall, wall[:1]]) - low) / PIXEL
        points = [(float(x), height - 1 - float(y)) for x, y in pixels]
        ImageDraw.Draw(image).line(points, fill=0, width=2)
    image.save(folder / "track.png")
    (folder / "track.yaml").write_text(
        f"image: track.png\nresolution: {PIXEL}\norigin: [{low[0]}, {low[1]}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.5\nfree_thresh: 0.2\n",
        encoding="utf-8",
    )
    return folder / "track.yaml"


def _ours(grid: kernels.Grid) -> Scan:
    beams = kernels.Beams(unit_vectors(BEAMS), REACH)

    def scan(pose: NDArray[np.float64]) -> NDArray[np.float64]:
        ranges = np.empty((1, len(BEAMS)))
        kernels.scan_poses(grid, pose[None], beams, ranges)
        return ranges[0]

    return scan


def _theirs(file: Path, drawn: Path) -> Scan:
    spec = importlib.util.spec_from_file_location("f1tenth_laser_models", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where numba looks for compiled code
    spec.loader.exec_module(module)
    simulator = module.ScanSimulator2D(len(BEAMS), float(np.ptp(BEAMS)), max_range=REACH)
    simulator.set_map(str(drawn), ".png")
    return lambda pose: simulator.scan(pose, None)
