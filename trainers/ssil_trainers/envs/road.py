"""The road of a highway-env racetrack as plain arrays: lanes in driving order and its two edges.

highway-env describes a road as a graph of sections, each a list of parallel lanes, straight or
circular, numbered from left to right. The outer edges of consecutive sections meet to within a
few centimetres; here the remaining gaps are closed by straight pieces, so that each edge is one
closed curve and no ray slips through.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from highway_env.road.lane import AbstractLane, CircularLane
from highway_env.road.road import RoadNetwork
from numpy.typing import NDArray

LaneIndex = tuple[str, str, int]
_TOUCH = 1e-9
"""Slack at the ends of an edge piece: a ray through a joint must hit one of its two sides."""


@dataclass(frozen=True, eq=False)
class Road:
    """Lanes (n) and edge pieces of a closed road.

    number: highway-env's lane index → row; length (n,) metres; curvature (n,) 1/m, positive where
    the heading grows; axis_offset (n,) metres from the road's centre line to the lane's, positive
    to the right; half_width (n,) metres of the road, all lanes together; following (n,) the row of
    the lane that continues this one.
    segments (m, 4): x, y of the start, x, y of the end. arcs (k, 5): x, y of the centre, radius,
    phase of the middle, half of the opening angle.
    """

    number: dict[LaneIndex, int]
    length: NDArray[np.float64]
    curvature: NDArray[np.float64]
    axis_offset: NDArray[np.float64]
    half_width: NDArray[np.float64]
    following: NDArray[np.int64]
    segments: NDArray[np.float64]
    arcs: NDArray[np.float64]

    @classmethod
    def of(cls, network: RoadNetwork) -> Road:
        """Read the geometry out of highway-env's own road object."""
        indices = list(_lane_indices(network))
        lanes = [network.get_lane(index) for index in indices]
        number = {index: row for row, index in enumerate(indices)}
        segments, arcs = _edges([network.graph[a][b] for a, b, i in indices if i == 0])
        return cls(
            number=number,
            length=np.array([lane.length for lane in lanes], dtype=np.float64),
            curvature=np.array([_curvature(lane) for lane in lanes]),
            axis_offset=np.array([_axis_offset(network, index) for index in indices]),
            half_width=np.array([_half_width(network, index) for index in indices]),
            following=np.array([number[_following(network, index)] for index in indices]),
            segments=np.array(segments, dtype=np.float64).reshape(-1, 4),
            arcs=np.array(arcs, dtype=np.float64).reshape(-1, 5),
        )

    def curvature_ahead(self, lane: int, longitudinal: float, distance: float) -> float:
        """Return the curvature [1/m] of the lane and its continuations `distance` metres ahead."""
        longitudinal += distance
        while longitudinal > self.length[lane]:
            longitudinal -= self.length[lane]
            lane = int(self.following[lane])
        return float(self.curvature[lane])

    def ray_distances(
        self, x: float, y: float, directions: NDArray[np.float64], reach: float
    ) -> NDArray[np.float64]:
        """Return how far each ray from (x, y) runs [m] before it meets an edge, at most `reach`.

        directions (r,) are angles in the world [rad].
        """
        cos, sin = np.cos(directions)[:, None], np.sin(directions)[:, None]
        to_segments = _meet_segments(x, y, cos, sin, self.segments)
        to_arcs = _meet_arcs(x, y, cos, sin, self.arcs)
        nearest = np.minimum(to_segments.min(axis=1), to_arcs.min(axis=1, initial=np.inf))
        return np.minimum(nearest, reach)


def _meet_segments(
    x: float, y: float, cos: NDArray[Any], sin: NDArray[Any], segments: NDArray[Any]
) -> NDArray[np.float64]:
    start_x, start_y = segments[:, 0] - x, segments[:, 1] - y
    along_x, along_y = segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]
    across = cos * along_y - sin * along_x
    parallel = across == 0
    across = np.where(parallel, 1.0, across)
    distance = (start_x * along_y - start_y * along_x) / across
    share = (start_x * sin - start_y * cos) / across
    hit = ~parallel & (distance >= 0) & (share >= -_TOUCH) & (share <= 1 + _TOUCH)
    return np.where(hit, distance, np.inf)


def _meet_arcs(
    x: float, y: float, cos: NDArray[Any], sin: NDArray[Any], arcs: NDArray[Any]
) -> NDArray[np.float64]:
    away_x, away_y, radius = x - arcs[:, 0], y - arcs[:, 1], arcs[:, 2]
    middle_x, middle_y = np.cos(arcs[:, 3]), np.sin(arcs[:, 3])
    to_middle = -(cos * away_x + sin * away_y)
    square = to_middle**2 - (away_x**2 + away_y**2 - radius**2)
    half_chord = np.sqrt(np.maximum(square, 0.0))
    nearest = np.full(to_middle.shape, np.inf)
    for distance in (to_middle + half_chord, to_middle - half_chord):
        seen_x, seen_y = away_x + distance * cos, away_y + distance * sin
        within = (seen_x * middle_x + seen_y * middle_y) / radius >= np.cos(arcs[:, 4]) - _TOUCH
        hit = (square >= 0) & (distance >= 0) & within
        nearest = np.where(hit, np.minimum(distance, nearest), nearest)
    return nearest


def _lane_indices(network: RoadNetwork) -> Iterator[LaneIndex]:
    for origin, onward in network.graph.items():
        for target, lanes in onward.items():
            for lane in range(len(lanes)):
                yield origin, target, lane


def _following(network: RoadNetwork, index: LaneIndex) -> LaneIndex:
    _, node, lane = index
    (target,) = network.graph[node]
    return node, target, lane


def _curvature(lane: AbstractLane) -> float:
    return lane.direction / lane.radius if isinstance(lane, CircularLane) else 0.0


def _axis_offset(network: RoadNetwork, index: LaneIndex) -> float:
    origin, target, lane = index
    parallel = network.graph[origin][target]
    return (lane - (len(parallel) - 1) / 2) * parallel[lane].width_at(0.0)


def _half_width(network: RoadNetwork, index: LaneIndex) -> float:
    origin, target, _ = index
    return sum(lane.width_at(0.0) for lane in network.graph[origin][target]) / 2


def _edges(sections: list[list[AbstractLane]]) -> tuple[list[Any], list[Any]]:
    """Return segments and arcs of the left and the right edge, gaps closed."""
    segments, arcs = [], []
    for lane_of_section, side in ((0, -0.5), (-1, 0.5)):
        lanes = [section[lane_of_section] for section in sections]
        for lane, onward in zip(lanes, lanes[1:] + lanes[:1], strict=True):
            lateral = side * lane.width_at(0.0)
            end = lane.position(lane.length, lateral)
            if isinstance(lane, CircularLane):
                radius = lane.radius - lateral * lane.direction
                middle = (lane.start_phase + lane.end_phase) / 2
                half = abs(lane.end_phase - lane.start_phase) / 2
                arcs.append((*lane.center, radius, middle, half))
            else:
                segments.append((*lane.position(0.0, lateral), *end))
            joint = onward.position(0.0, side * onward.width_at(0.0))
            if np.linalg.norm(joint - end) > _TOUCH:
                segments.append((*end, *joint))
    return segments, arcs
