"""The compiled half of the racetrack: lanes, rays, motion, state and reward as numba functions.

All of them stand in this one file because numba's cache checks the time stamp of no other file; for
the same reason every constant of the environment is an argument (`Track`, `Motion`).

Last bits matter: a start is in the very middle of a lane, whose rays may just touch an edge or just
miss it, and where sections overlap two lanes are equally near. So nothing here is reordered or
contracted, and tangents and their inverses, which NumPy vectorizes in its own way, come from NumPy.

Motion and the choice of the lane are highway-env's: the kinematic bicycle of its `Vehicle`, and the
lane that is nearest when meters off the lane and radians against it are added up.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

_TOUCH = 1e-9
"""Slack at the ends of an edge piece: a ray through a joint must hit one of its two sides."""

Floats = NDArray[np.float64]


class Lanes(NamedTuple):
    """The lanes of a road, one number for each lane (n,).

    Parameters
    ----------
    turn:
        0 straight, 1 where the heading grows, -1 where it falls.
    x, y:
        Start of a straight, center of a turn [m].
    along_x, along_y, heading:
        Direction of a straight, as a unit vector and as an angle [rad].
    radius, phase:
        Of a turn, and its angle at the start [m, rad].
    length:
        Length of the lane [m].
    curvature:
        Signed curvature [1/m].
    axis_offset:
        From the road's center line to the lane's, right positive [m].
    half_width:
        Half the width of the whole road [m].
    following:
        Row of the lane that continues this one.
    """

    turn: NDArray[np.int64]
    x: Floats
    y: Floats
    along_x: Floats
    along_y: Floats
    heading: Floats
    radius: Floats
    phase: Floats
    length: Floats
    curvature: Floats
    axis_offset: Floats
    half_width: Floats
    following: NDArray[np.int64]


class Edges(NamedTuple):
    """The two edges of a road, in pieces.

    Parameters
    ----------
    segments:
        Straight pieces (m, 4): x, y of the start, x, y of the end [m].
    arcs:
        Round pieces (k, 6): x, y of the center, radius [m], cosine and sine of the phase of the
        middle, cosine of half of the opening angle.
    """

    segments: Floats
    arcs: Floats


class Sight(NamedTuple):
    """What a state is made of.

    Parameters
    ----------
    rays:
        Angles of the rays off the car's axis (r,) [rad].
    reach:
        How far a ray reaches [m].
    ahead:
        Distances ahead at which the curvature is read (c,) [m].
    offset_scale, speed_scale, curvature_scale:
        Units of the state: m, m/s, and the inverse of 1/m.
    """

    rays: Floats
    reach: float
    ahead: Floats
    offset_scale: float
    speed_scale: float
    curvature_scale: float


class Motion(NamedTuple):
    """The kinematic bicycle.

    Parameters
    ----------
    acceleration:
        At full throttle [m/s²].
    steering:
        Angle of the wheels at full steering [rad].
    car_length:
        Length of the car [m].
    slowest, fastest:
        Bounds of the speed [m/s].
    seconds:
        Duration of a frame of the simulation [s].
    frames:
        Frames of one decision.
    """

    acceleration: float
    steering: float
    car_length: float
    slowest: float
    fastest: float
    seconds: float
    frames: int


class Track(NamedTuple):
    """All that does not change while cars drive: the road, what a state reads, the bicycle."""

    lanes: Lanes
    edges: Edges
    sight: Sight
    motion: Motion


class Output(NamedTuple):
    """What a step of n cars writes.

    Parameters
    ----------
    states:
        What each car sees (n, 29).
    rewards:
        What the step was worth (n,).
    off_road:
        Whether the middle of the car is beyond an edge of the road (n,).
    """

    states: Floats
    rewards: Floats
    off_road: NDArray[np.bool_]

    @classmethod
    def allocate(cls, count: int, width: int) -> Output:
        """Return room for what cars write.

        Parameters
        ----------
        count:
            Number of cars.
        width:
            Numbers of a state.
        """
        return cls(np.zeros((count, width)), np.zeros(count), np.zeros(count, dtype=np.bool_))


class Cars(NamedTuple):
    """Where n cars are and how they steer.

    Parameters
    ----------
    pose:
        x, y [m], heading [rad] and speed [m/s] (n, 4).
    lane:
        Row of the car's lane (n,).
    local:
        Meters along and off that lane, and heading error [rad] (n, 3).
    action:
        Last throttle and steering in [-1, 1] (n, 2).
    slip:
        Slip angle of that steering [rad] (n, 2): as highway-env rounds it, and as a state does.
    """

    pose: Floats
    lane: NDArray[np.int64]
    local: Floats
    action: Floats
    slip: Floats

    @classmethod
    def allocate(cls, count: int) -> Cars:
        """Return room for cars that are nowhere yet.

        Parameters
        ----------
        count:
            Number of cars.
        """
        return cls(
            pose=np.zeros((count, 4)),
            lane=np.zeros(count, dtype=np.int64),
            local=np.zeros((count, 3)),
            action=np.zeros((count, 2)),
            slip=np.zeros((count, 2)),
        )

    def act(self, actions: Floats, motion: Motion) -> None:
        """Set the actions of all cars.

        Parameters
        ----------
        actions:
            Throttle and steering (n, 2) in [-1, 1].
        motion:
            The bicycle, which turns steering into an angle.
        """
        steering = actions[:, 1]
        limit = motion.steering
        self.action[:] = actions
        self.slip[:, 0] = (steering + 1.0) * (2 * limit) / 2 - limit
        self.slip[:, 1] = steering * limit
        np.arctan(0.5 * np.tan(self.slip), out=self.slip)


_compiled: Any = njit(cache=True, error_model="numpy", nogil=True)
"""Divisions by zero give inf or nan, as in NumPy."""


def _generate_fused_product(_: Any, a: types.Type, b: types.Type, c: types.Type) -> Any:
    """Return a·b + c rounded once, as BLAS computes the second product of a sum of two."""

    def generate(_: Any, builder: Any, __: Any, numbers: Any) -> Any:
        return builder.fma(*numbers)

    return types.float64(types.float64, types.float64, types.float64), generate


_fma: Any = intrinsic(_generate_fused_product)


@_compiled
def _wrap_angle(angle: float) -> float:
    """Return the angle in [-π, π)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


@_compiled
def _excess(longitudinal: float, length: float) -> float:
    """Return how many meters a point is before the start or beyond the end of a lane."""
    return max(longitudinal - length, 0.0) + max(-longitudinal, 0.0)


@_compiled
def _meters_along_turn(lanes: Lanes, row: int, angle: float) -> float:
    """Return the meters along a turn of a point at an angle from its center."""
    phase = lanes.phase[row]
    return lanes.turn[row] * (phase + _wrap_angle(angle - phase) - phase) * lanes.radius[row]


@_compiled
def _lane_heading(lanes: Lanes, row: int, longitudinal: float) -> float:
    """Return the lane's heading [rad] so many meters along it."""
    turn = lanes.turn[row]
    if turn == 0:
        return lanes.heading[row]
    return turn * longitudinal / lanes.radius[row] + lanes.phase[row] + math.pi / 2 * turn


@_compiled
def _locate(cars: Cars, car: int, lanes: Lanes, angles: Floats) -> None:
    """Find the car's lane, the first of the nearest, and where on it the car is.

    angles (lanes,) are those of the car from the lanes' x, y. Meters off a lane are a lower bound
    of the distance to it. Where sections overlap by a few degrees, the last bit decides between
    their lanes: hence `_fma`, and angles from NumPy.
    """
    x = cars.pose[car, 0]
    y = cars.pose[car, 1]
    heading = cars.pose[car, 2]
    nearest = math.inf
    for row in range(lanes.turn.size):
        away_x = x - lanes.x[row]
        away_y = y - lanes.y[row]
        turn = lanes.turn[row]
        if turn == 0:
            lateral = _fma(away_y, lanes.along_x[row], -away_x * lanes.along_y[row])
            if abs(lateral) >= nearest:
                continue
            longitudinal = _fma(away_y, lanes.along_y[row], away_x * lanes.along_x[row])
        else:
            lateral = turn * (lanes.radius[row] - math.sqrt(_fma(away_y, away_y, away_x * away_x)))
            if abs(lateral) >= nearest:
                continue
            longitudinal = _meters_along_turn(lanes, row, angles[row])
        off = abs(lateral) + _excess(longitudinal, lanes.length[row])
        if off >= nearest:
            continue
        error = _wrap_angle(heading - _lane_heading(lanes, row, longitudinal))
        if off + abs(error) < nearest:
            nearest = off + abs(error)
            cars.lane[car] = row
            cars.local[car, 0] = longitudinal
            cars.local[car, 1] = lateral
            cars.local[car, 2] = error


@_compiled
def _drive_car(cars: Cars, car: int, motion: Motion) -> None:
    """Drive the car for one decision; too fast, it is slowed down as highway-env does."""
    x = cars.pose[car, 0]
    y = cars.pose[car, 1]
    heading = cars.pose[car, 2]
    speed = cars.pose[car, 3]
    throttle = cars.action[car, 0]
    slip = cars.slip[car, 0]
    acceleration = (throttle + 1.0) * (2 * motion.acceleration) / 2 - motion.acceleration
    for _ in range(motion.frames):
        if speed > motion.fastest:
            acceleration = min(acceleration, motion.fastest - speed)
        elif speed < motion.slowest:
            acceleration = max(acceleration, motion.slowest - speed)
        x += speed * math.cos(heading + slip) * motion.seconds
        y += speed * math.sin(heading + slip) * motion.seconds
        heading += speed * math.sin(slip) / (motion.car_length / 2) * motion.seconds
        speed += acceleration * motion.seconds
    cars.pose[car, 0] = x
    cars.pose[car, 1] = y
    cars.pose[car, 2] = heading
    cars.pose[car, 3] = speed


@_compiled
def curvature_ahead(lanes: Lanes, lane: int, longitudinal: float, distance: float) -> float:
    """Return the curvature [1/m] of the lane and its continuations `distance` meters ahead.

    Parameters
    ----------
    lanes:
        The lanes of the road.
    lane:
        Row of the lane to begin in.
    longitudinal:
        Meters along that lane.
    distance:
        Meters to go from there.
    """
    longitudinal += distance
    while longitudinal > lanes.length[lane]:
        longitudinal -= lanes.length[lane]
        lane = lanes.following[lane]
    return lanes.curvature[lane]


@_compiled
def shorten_rays(x: float, y: float, edges: Edges, rays: Floats) -> None:
    """Shorten each ray from (x, y) to where it meets an edge.

    The inner loops have no branches, so that the compiler makes vectors of them.

    Parameters
    ----------
    x, y:
        Where the rays begin [m].
    edges:
        What stops them.
    rays:
        Cosine and sine of each ray's angle in the world, and how far it runs [m] (3, r): at first
        its reach, shortened here.
    """
    segments = edges.segments
    arcs = edges.arcs
    cos = rays[0]
    sin = rays[1]
    nearest = rays[2]
    count = cos.size
    for piece in range(segments.shape[0]):
        start_x = segments[piece, 0] - x
        start_y = segments[piece, 1] - y
        along_x = segments[piece, 2] - segments[piece, 0]
        along_y = segments[piece, 3] - segments[piece, 1]
        turned = start_x * along_y - start_y * along_x
        for ray in range(count):
            across = cos[ray] * along_y - sin[ray] * along_x
            distance = turned / across
            share = (start_x * sin[ray] - start_y * cos[ray]) / across
            hit = (across != 0) & (distance >= 0) & (share >= -_TOUCH) & (share <= 1 + _TOUCH)
            nearest[ray] = distance if hit & (distance < nearest[ray]) else nearest[ray]
    for piece in range(arcs.shape[0]):
        away_x = x - arcs[piece, 0]
        away_y = y - arcs[piece, 1]
        radius = arcs[piece, 2]
        middle_x = arcs[piece, 3]
        middle_y = arcs[piece, 4]
        opening = arcs[piece, 5] - _TOUCH
        beyond = away_x * away_x + away_y * away_y - radius * radius
        for ray in range(count):
            # A line meets a circle twice, half a chord before and after its nearest point.
            to_middle = -(cos[ray] * away_x + sin[ray] * away_y)
            square = to_middle * to_middle - beyond
            half_chord = math.sqrt(max(square, 0.0))
            far = to_middle + half_chord
            near = to_middle - half_chord
            far_x = away_x + far * cos[ray]
            far_y = away_y + far * sin[ray]
            near_x = away_x + near * cos[ray]
            near_y = away_y + near * sin[ray]
            far_within = (far_x * middle_x + far_y * middle_y) / radius >= opening
            near_within = (near_x * middle_x + near_y * middle_y) / radius >= opening
            hit = (square >= 0) & (far >= 0) & far_within & (far < nearest[ray])
            nearest[ray] = far if hit else nearest[ray]
            hit = (square >= 0) & (near >= 0) & near_within & (near < nearest[ray])
            nearest[ray] = near if hit else nearest[ray]


@_compiled
def _observe_car(cars: Cars, car: int, track: Track, state: Floats) -> float:
    """Write the state (29,) of the car; return its reward."""
    lanes = track.lanes
    sight = track.sight
    speed = cars.pose[car, 3]
    longitudinal = cars.local[car, 0]
    lateral = cars.local[car, 1]
    error = cars.local[car, 2]
    lane = cars.lane[car]
    count = sight.rays.size
    rays = np.empty((3, count))
    for ray in range(count):
        angle = cars.pose[car, 2] + sight.rays[ray]
        rays[0, ray] = math.cos(angle)
        rays[1, ray] = math.sin(angle)
        rays[2, ray] = sight.reach
    shorten_rays(cars.pose[car, 0], cars.pose[car, 1], track.edges, rays)
    for ray in range(count):
        state[ray] = rays[2, ray] / sight.reach
    slip = cars.slip[car, 1]
    forward = speed * math.cos(slip)
    sideways = speed * math.sin(slip)
    offset = (lateral + lanes.axis_offset[lane]) / sight.offset_scale
    state[count] = error
    state[count + 1] = offset
    state[count + 2] = forward / sight.speed_scale
    state[count + 3] = sideways / sight.speed_scale
    state[count + 4] = sideways / (track.motion.car_length / 2)
    state[count + 5] = cars.action[car, 0]
    state[count + 6] = cars.action[car, 1]
    for place in range(sight.ahead.size):
        curvature = curvature_ahead(lanes, lane, longitudinal, sight.ahead[place])
        state[count + 7 + place] = curvature * sight.curvature_scale
    along = math.cos(error)
    against = math.sin(error)
    straying = 2 * forward * abs(offset * against)
    return forward * along - abs(sideways * against) - straying - sideways * along


@_compiled
def drive_cars(cars: Cars, which: NDArray[np.int64], motion: Motion) -> None:
    """Drive some cars for one decision, by the actions that were set.

    Parameters
    ----------
    cars:
        All cars; poses are written.
    which:
        Rows of the cars to drive (k,).
    motion:
        The bicycle.
    """
    for car in which:
        _drive_car(cars, car, motion)


@_compiled
def place_cars(cars: Cars, which: NDArray[np.int64], starts: Floats, lanes: Lanes) -> None:
    """Put some cars in the middle of lanes, along their heading, with wheels straight.

    Parameters
    ----------
    cars:
        All cars; poses, actions and slips are written.
    which:
        Rows of the cars to put (k,).
    starts:
        Row of the lane, meters along it, speed [m/s] (k, 3).
    lanes:
        The lanes of the road.
    """
    for number in range(which.size):
        car = which[number]
        row = int(starts[number, 0])
        longitudinal = starts[number, 1]
        if lanes.turn[row] == 0:
            cars.pose[car, 0] = lanes.x[row] + longitudinal * lanes.along_x[row]
            cars.pose[car, 1] = lanes.y[row] + longitudinal * lanes.along_y[row]
        else:
            phase = lanes.turn[row] * longitudinal / lanes.radius[row] + lanes.phase[row]
            cars.pose[car, 0] = lanes.x[row] + lanes.radius[row] * math.cos(phase)
            cars.pose[car, 1] = lanes.y[row] + lanes.radius[row] * math.sin(phase)
        cars.pose[car, 2] = _lane_heading(lanes, row, longitudinal)
        cars.pose[car, 3] = starts[number, 2]
        cars.action[car] = 0.0
        cars.slip[car] = 0.0


@_compiled
def observe_cars(
    cars: Cars, which: NDArray[np.int64], angles: Floats, track: Track, output: Output
) -> None:
    """Find the lanes of some cars, and write what they see and what it is worth.

    Parameters
    ----------
    cars:
        All cars; lanes and places on them are written.
    which:
        Rows of the cars to look at (k,).
    angles:
        Angle of each of these cars from each lane's x, y [rad] (k, lanes), computed by NumPy.
    track:
        The road, what a state reads, the bicycle.
    output:
        Where the cars' rows are written.
    """
    lanes = track.lanes
    for number in range(which.size):
        car = which[number]
        _locate(cars, car, lanes, angles[number])
        output.rewards[car] = _observe_car(cars, car, track, output.states[car])
        lane = cars.lane[car]
        off = abs(cars.local[car, 1] + lanes.axis_offset[lane])
        output.off_road[car] = off > lanes.half_width[lane]
