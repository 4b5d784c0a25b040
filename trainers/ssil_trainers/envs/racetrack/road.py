"""The road of a highway-env racetrack as plain arrays: lanes in driving order and its two edges.

highway-env describes a road as a graph of sections, each a list of parallel lanes, straight or
circular, numbered from left to right. The outer edges of consecutive sections meet to within a
few centimeters; here the remaining gaps are closed by straight pieces, so that each edge is one
closed curve and no ray slips through.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeGuard

import numpy as np
from highway_env.road.lane import AbstractLane, CircularLane, StraightLane
from highway_env.road.road import RoadNetwork
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.racetrack import kernels
from ssil_trainers.envs.racetrack.kernels import Edges, Lanes

LaneIndex = tuple[str, str, int]
_TOUCH = 1e-9
"""Ends of edge pieces that are closer than this [m] need no piece between them."""


@dataclass(frozen=True, eq=False)
class Road:
    """The lanes of a closed road and its edges.

    Parameters
    ----------
    number:
        From highway-env's lane index to the row of the lane.
    lanes:
        The lanes in driving order.
    edges:
        The left and the right edge.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.env import RacetrackEnv
    >>> road = RacetrackEnv().road
    >>> len(road.number), road.curvature_ahead(lane=0, longitudinal=0.0, distance=59.0)
    (18, -0.05)
    >>> road.ray_distances(70.0, 1.0, np.array([-np.pi / 2, np.pi / 2]), reach=60.0)
    array([3.5, 6.5])
    """

    number: dict[LaneIndex, int]
    lanes: Lanes
    edges: Edges

    @classmethod
    def from_network(cls, network: RoadNetwork) -> Road:
        """Read the geometry out of highway-env's own road object.

        Parameters
        ----------
        network:
            highway-env's graph of sections.

        Returns
        -------
        Road
            The same road as arrays.

        Raises
        ------
        InvalidInputError
            For a lane that is neither straight nor circular.
        """
        indices = list(_lane_indices(network))
        lanes = [network.get_lane(index) for index in indices]
        number = {index: row for row, index in enumerate(indices)}
        placed = [_lane_geometry(index, lane) for index, lane in zip(indices, lanes, strict=True)]
        segments, arcs = _edges([network.graph[a][b] for a, b, i in indices if i == 0])
        return cls(
            number=number,
            lanes=Lanes(
                np.array([lane.direction if _turns(lane) else 0 for lane in lanes], np.int64),
                *np.array(placed, dtype=np.float64).T.copy(),
                length=np.array([lane.length for lane in lanes], dtype=np.float64),
                curvature=np.array([_curvature(lane) for lane in lanes]),
                axis_offset=np.array([_axis_offset(network, index) for index in indices]),
                half_width=np.array([_half_width(network, index) for index in indices]),
                following=np.array([number[_next_lane(network, index)] for index in indices]),
            ),
            edges=Edges(
                segments=np.array(segments, dtype=np.float64).reshape(-1, 4),
                arcs=np.array(arcs, dtype=np.float64).reshape(-1, 6),
            ),
        )

    @cached_property
    def shares(self) -> NDArray[np.float64]:
        """Cumulative share of the lanes' total length (n,); the last is 1."""
        shares = (self.lanes.length / self.lanes.length.sum()).cumsum()
        return shares / shares[-1]

    def curvature_ahead(self, lane: int, longitudinal: float, distance: float) -> float:
        """Return the curvature of the road some meters ahead, right positive [1/m].

        Parameters
        ----------
        lane:
            Row of the lane to begin in.
        longitudinal:
            Meters along that lane.
        distance:
            Meters to go from there, into the lanes that continue it.
        """
        return kernels.curvature_ahead(self.lanes, lane, longitudinal, distance)

    def ray_distances(
        self,
        x: float,
        y: float,
        directions: NDArray[np.float64],
        reach: float,
        *,
        boxes: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Return how far each ray from a point runs before it meets an edge.

        Parameters
        ----------
        x, y:
            Where the rays begin [m].
        directions:
            Angles of the rays in the world [rad] (r,).
        reach:
            Greatest length of a ray [m].
        boxes:
            Sides of things that stand on the road, as `Edges.segments` (b, 4).

        Returns
        -------
        ndarray of float64
            Lengths [m], at most `reach` (r,).
        """
        edges = self.edges
        if boxes is not None:
            edges = Edges(np.concatenate([edges.segments, boxes]), edges.arcs)
        rays = np.stack([np.cos(directions), np.sin(directions), np.full(len(directions), reach)])
        kernels.shorten_rays(x, y, edges, rays)
        return rays[2]


def _lane_indices(network: RoadNetwork) -> Iterator[LaneIndex]:
    """Yield all lanes, section by section."""
    for origin, onward in network.graph.items():
        for target, lanes in onward.items():
            for lane in range(len(lanes)):
                yield origin, target, lane


def _next_lane(network: RoadNetwork, index: LaneIndex) -> LaneIndex:
    """Return the lane that continues one, at the same place from the left."""
    _, node, lane = index
    (target,) = network.graph[node]
    return node, target, lane


def _lane_geometry(index: LaneIndex, lane: AbstractLane) -> tuple[float, ...]:
    """Return x to phase of `Lanes`."""
    if type(lane) is StraightLane:
        return (*lane.start, *lane.direction, float(lane.heading), 0.0, 0.0)
    if type(lane) is CircularLane:
        return (*lane.center, 0.0, 0.0, 0.0, lane.radius, lane.start_phase)
    raise InvalidInputError(
        f"lane {index}: expected a straight or a circular one, found {type(lane).__name__}"
    )


def _turns(lane: AbstractLane) -> TypeGuard[CircularLane]:
    return isinstance(lane, CircularLane)


def _curvature(lane: AbstractLane) -> float:
    return lane.direction / lane.radius if _turns(lane) else 0.0


def _axis_offset(network: RoadNetwork, index: LaneIndex) -> float:
    origin, target, lane = index
    parallel = network.graph[origin][target]
    return (lane - (len(parallel) - 1) / 2) * parallel[lane].width_at(0.0)


def _half_width(network: RoadNetwork, index: LaneIndex) -> float:
    origin, target, _ = index
    return sum(lane.width_at(0.0) for lane in network.graph[origin][target]) / 2


def _edges(sections: list[list[AbstractLane]]) -> tuple[list[Any], list[Any]]:
    """Return segments and arcs of the left and the right edge, gaps closed."""
    segments = []
    arcs = []
    for lane_of_section, side in ((0, -0.5), (-1, 0.5)):
        lanes = [section[lane_of_section] for section in sections]
        for lane, onward in zip(lanes, lanes[1:] + lanes[:1], strict=True):
            lateral = side * lane.width_at(0.0)
            end = lane.position(lane.length, lateral)
            if _turns(lane):
                radius = lane.radius - lateral * lane.direction
                middle = (lane.start_phase + lane.end_phase) / 2
                half = abs(lane.end_phase - lane.start_phase) / 2
                arcs.append((*lane.center, radius, np.cos(middle), np.sin(middle), np.cos(half)))
            else:
                segments.append((*lane.position(0.0, lateral), *end))
            joint = onward.position(0.0, side * onward.width_at(0.0))
            if np.linalg.norm(joint - end) > _TOUCH:
                segments.append((*end, *joint))
    return segments, arcs
