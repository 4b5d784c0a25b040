"""The racetrack environment as plain NumPy would have it: rays and curvature without a compiler."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_trainers.envs.racetrack.env import RacetrackEnv
from ssil_trainers.envs.racetrack.road import Road

TOUCH = 1e-9


class PlainRacetrack(RacetrackEnv):
    """`RacetrackEnv` with the same observation, bit for bit, from NumPy alone."""

    def __init__(self, **settings: Any) -> None:
        """Take the settings of `RacetrackEnv`."""
        super().__init__(**settings)
        self._road = PlainRoad(**{f.name: getattr(self._road, f.name) for f in fields(Road)})


class PlainRoad(Road):
    """The road whose rays NumPy casts, all rays and all pieces of the edges at once."""

    def curvature_ahead(self, lane: int, longitudinal: float, distance: float) -> float:
        """Walk along the lanes in Python."""
        longitudinal += distance
        while longitudinal > self.lanes.length[lane]:
            longitudinal -= self.lanes.length[lane]
            lane = int(self.lanes.following[lane])
        return float(self.lanes.curvature[lane])

    def ray_distances(
        self,
        x: float,
        y: float,
        directions: NDArray[np.float64],
        reach: float,
        *,
        boxes: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Meet segments and arcs; there are no boxes."""
        cos = np.cos(directions)[:, None]
        sin = np.sin(directions)[:, None]
        to_segments = _meet_segments(x, y, cos, sin, self.edges.segments)
        to_arcs = _meet_arcs(x, y, cos, sin, self.edges.arcs)
        nearest = np.minimum(to_segments.min(axis=1), to_arcs.min(axis=1, initial=np.inf))
        return np.minimum(nearest, reach)


def _meet_segments(
    x: float, y: float, cos: NDArray[Any], sin: NDArray[Any], segments: NDArray[Any]
) -> NDArray[np.float64]:
    start_x = segments[:, 0] - x
    start_y = segments[:, 1] - y
    along_x = segments[:, 2] - segments[:, 0]
    along_y = segments[:, 3] - segments[:, 1]
    across = cos * along_y - sin * along_x
    parallel = across == 0
    across = np.where(parallel, 1.0, across)
    distance = (start_x * along_y - start_y * along_x) / across
    share = (start_x * sin - start_y * cos) / across
    hit = ~parallel & (distance >= 0) & (share >= -TOUCH) & (share <= 1 + TOUCH)
    return np.where(hit, distance, np.inf)


def _meet_arcs(
    x: float, y: float, cos: NDArray[Any], sin: NDArray[Any], arcs: NDArray[Any]
) -> NDArray[np.float64]:
    away_x = x - arcs[:, 0]
    away_y = y - arcs[:, 1]
    radius = arcs[:, 2]
    to_middle = -(cos * away_x + sin * away_y)
    square = to_middle**2 - (away_x**2 + away_y**2 - radius**2)
    half_chord = np.sqrt(np.maximum(square, 0.0))
    nearest = np.full(to_middle.shape, np.inf)
    for distance in (to_middle + half_chord, to_middle - half_chord):
        seen_x = away_x + distance * cos
        seen_y = away_y + distance * sin
        within = (seen_x * arcs[:, 3] + seen_y * arcs[:, 4]) / radius >= arcs[:, 5] - TOUCH
        hit = (square >= 0) & (distance >= 0) & within
        nearest = np.where(hit, np.minimum(distance, nearest), nearest)
    return nearest
