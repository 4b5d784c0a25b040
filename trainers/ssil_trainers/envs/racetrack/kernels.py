"""The compiled half of the racetrack: lanes, rays, motion, state and reward as numba functions.

All of them stand in this one file because numba's cache knows the time stamp of no other; for the
same reason every constant of the environment is an argument (`Sight`, `Motion`).

Last bits matter: a start is in the very middle of a lane, whose rays may just touch an edge or just
miss it, and where sections overlap two lanes are equally near. So nothing here is reordered or
contracted, and tangents and their inverses, which NumPy vectorises in its own way, come from NumPy.

Motion and the choice of the lane are highway-env's: the kinematic bicycle of its `Vehicle`, and the
lane that is nearest when metres off the lane and radians against it are added up.
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
    """The lanes of a road, one number for each lane (n).

    turn: 0 straight, 1 where the heading grows, -1 where it falls. x, y: start of a straight,
    centre of a turn. along_x, along_y, heading: direction of a straight; radius, phase: of a turn,
    and its angle at the start. length in metres; curvature in 1/m; axis_offset: metres from the
    road's centre line to the lane's, right positive; half_width: metres of the whole road;
    following: the row of the lane that continues this one.
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

    segments (m, 4): x, y of the start, x, y of the end. arcs (k, 6): x, y of the centre, radius,
    cosine and sine of the phase of the middle, cosine of half of the opening angle.
    """

    segments: Floats
    arcs: Floats


class Sight(NamedTuple):
    """What a state is made of: angles of the rays off the car's axis [rad], metres that a ray
    reaches, metres ahead at which the curvature is seen, and the units of the state.
    """

    rays: Floats
    reach: float
    ahead: Floats
    offset_scale: float
    speed_scale: float
    curvature_scale: float


class Motion(NamedTuple):
    """The bicycle: m/s² at full throttle, radians at full steering, metres of the car's length,
    lowest and highest speed [m/s], seconds of a frame, and frames of a decision.
    """

    acceleration: float
    steering: float
    car_length: float
    slowest: float
    fastest: float
    seconds: float
    frames: int


class Cars(NamedTuple):
    """Where n cars are: pose (n, 4) x, y [m], heading [rad], speed [m/s]; the row of their lane;
    local (n, 3) metres along and off that lane and heading error [rad]; their last action (n, 2);
    the slip (n, 2) [rad] that it makes, once as highway-env reckons it and once as a state does.
    """

    pose: Floats
    lane: NDArray[np.int64]
    local: Floats
    action: Floats
    slip: Floats

    @classmethod
    def allocate(cls, count: int) -> Cars:
        """Return so many cars that are nowhere yet."""
        pose, local = np.zeros((count, 4)), np.zeros((count, 3))
        action, slip = np.zeros((count, 2)), np.zeros((count, 2))
        return cls(pose, np.zeros(count, dtype=np.int64), local, action, slip)

    def act(self, actions: Floats, motion: Motion) -> None:
        """Set the actions (n, 2) of all cars."""
        wheel, most = actions[:, 1], motion.steering
        self.action[:] = actions
        self.slip[:, 0] = (wheel + 1.0) * (2 * most) / 2 - most
        self.slip[:, 1] = wheel * most
        np.arctan(0.5 * np.tan(self.slip), out=self.slip)


_compiled: Any = njit(cache=True, error_model="numpy", nogil=True)
"""Divisions by zero give inf or nan, as in NumPy."""


def _fused_multiply_add(_: Any, a: types.Type, b: types.Type, c: types.Type) -> Any:
    """Return a·b + c rounded once, as BLAS reckons the second product of a sum of two."""

    def generate(_: Any, builder: Any, __: Any, numbers: Any) -> Any:
        return builder.fma(*numbers)

    return types.float64(types.float64, types.float64, types.float64), generate


_fma: Any = intrinsic(_fused_multiply_add)


@_compiled
def _wrap_angle(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


@_compiled
def _beyond(longitudinal: float, length: float) -> float:
    return max(longitudinal - length, 0.0) + max(-longitudinal, 0.0)


@_compiled
def _on_turn(lanes: Lanes, row: int, angle: float) -> float:
    """Return the metres along a turn of a point at an angle from its centre."""
    phase = lanes.phase[row]
    return lanes.turn[row] * (phase + _wrap_angle(angle - phase) - phase) * lanes.radius[row]


@_compiled
def _heading_at(lanes: Lanes, row: int, longitudinal: float) -> float:
    turn = lanes.turn[row]
    if turn == 0:
        return lanes.heading[row]
    return turn * longitudinal / lanes.radius[row] + lanes.phase[row] + math.pi / 2 * turn


@_compiled
def _locate(cars: Cars, car: int, lanes: Lanes, angles: Floats) -> None:
    """Find the car's lane, the first of the nearest, and where on it the car is.

    Metres off a lane are a lower bound of the distance to it. Where sections overlap by a few
    degrees, the last bit decides between their lanes: hence `_fma`, and angles from NumPy.
    """
    x, y, heading = cars.pose[car, 0], cars.pose[car, 1], cars.pose[car, 2]
    nearest = math.inf
    for row in range(lanes.turn.size):
        away_x, away_y = x - lanes.x[row], y - lanes.y[row]
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
            longitudinal = _on_turn(lanes, row, angles[row])
        off = abs(lateral) + _beyond(longitudinal, lanes.length[row])
        if off >= nearest:
            continue
        error = _wrap_angle(heading - _heading_at(lanes, row, longitudinal))
        if off + abs(error) < nearest:
            nearest = off + abs(error)
            cars.lane[car] = row
            cars.local[car, 0], cars.local[car, 1] = longitudinal, lateral
            cars.local[car, 2] = error


@_compiled
def _drive(cars: Cars, car: int, motion: Motion) -> None:
    """Drive the car for one decision; too fast, it is slowed down as highway-env does."""
    x, y = cars.pose[car, 0], cars.pose[car, 1]
    heading, speed = cars.pose[car, 2], cars.pose[car, 3]
    throttle, slip = cars.action[car, 0], cars.slip[car, 0]
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
    cars.pose[car, 0], cars.pose[car, 1] = x, y
    cars.pose[car, 2], cars.pose[car, 3] = heading, speed


@_compiled
def curvature_ahead(lanes: Lanes, lane: int, longitudinal: float, distance: float) -> float:
    """Return the curvature [1/m] of the lane and its continuations `distance` metres ahead."""
    longitudinal += distance
    while longitudinal > lanes.length[lane]:
        longitudinal -= lanes.length[lane]
        lane = lanes.following[lane]
    return lanes.curvature[lane]


@_compiled
def ray_distances(
    x: float, y: float, cos: Floats, sin: Floats, edges: Edges, nearest: Floats
) -> None:
    """Shorten each of the rays to where it meets an edge.

    cos, sin (r,) of the rays' angles in the world; nearest (r,) metres, how far they reach. The
    inner loops have no branches, so that the compiler makes vectors of them.
    """
    segments, arcs, rays = edges.segments, edges.arcs, cos.size
    for piece in range(segments.shape[0]):
        start_x, start_y = segments[piece, 0] - x, segments[piece, 1] - y
        along_x = segments[piece, 2] - segments[piece, 0]
        along_y = segments[piece, 3] - segments[piece, 1]
        turned = start_x * along_y - start_y * along_x
        for ray in range(rays):
            across = cos[ray] * along_y - sin[ray] * along_x
            distance = turned / across
            share = (start_x * sin[ray] - start_y * cos[ray]) / across
            hit = (across != 0) & (distance >= 0) & (share >= -_TOUCH) & (share <= 1 + _TOUCH)
            nearest[ray] = distance if hit & (distance < nearest[ray]) else nearest[ray]
    for piece in range(arcs.shape[0]):
        away_x, away_y, radius = x - arcs[piece, 0], y - arcs[piece, 1], arcs[piece, 2]
        middle_x, middle_y, opening = arcs[piece, 3], arcs[piece, 4], arcs[piece, 5] - _TOUCH
        beyond = away_x * away_x + away_y * away_y - radius * radius
        for ray in range(rays):
            to_middle = -(cos[ray] * away_x + sin[ray] * away_y)
            square = to_middle * to_middle - beyond
            half_chord = math.sqrt(max(square, 0.0))
            far, near = to_middle + half_chord, to_middle - half_chord
            far_x, far_y = away_x + far * cos[ray], away_y + far * sin[ray]
            near_x, near_y = away_x + near * cos[ray], away_y + near * sin[ray]
            far_within = (far_x * middle_x + far_y * middle_y) / radius >= opening
            near_within = (near_x * middle_x + near_y * middle_y) / radius >= opening
            hit = (square >= 0) & (far >= 0) & far_within & (far < nearest[ray])
            nearest[ray] = far if hit else nearest[ray]
            hit = (square >= 0) & (near >= 0) & near_within & (near < nearest[ray])
            nearest[ray] = near if hit else nearest[ray]


@_compiled
def _observe(
    cars: Cars, car: int, lanes: Lanes, edges: Edges, sight: Sight, motion: Motion, state: Floats
) -> float:
    """Write the state (29,) of the car; return its reward."""
    speed, longitudinal = cars.pose[car, 3], cars.local[car, 0]
    lateral, error = cars.local[car, 1], cars.local[car, 2]
    lane, rays = cars.lane[car], sight.rays.size
    cos, sin = np.empty(rays), np.empty(rays)
    for ray in range(rays):
        angle = cars.pose[car, 2] + sight.rays[ray]
        cos[ray], sin[ray] = math.cos(angle), math.sin(angle)
    state[:rays] = sight.reach
    ray_distances(cars.pose[car, 0], cars.pose[car, 1], cos, sin, edges, state[:rays])
    state[:rays] /= sight.reach
    slip = cars.slip[car, 1]
    forward, sideways = speed * math.cos(slip), speed * math.sin(slip)
    offset = (lateral + lanes.axis_offset[lane]) / sight.offset_scale
    state[rays] = error
    state[rays + 1] = offset
    state[rays + 2] = forward / sight.speed_scale
    state[rays + 3] = sideways / sight.speed_scale
    state[rays + 4] = sideways / (motion.car_length / 2)
    state[rays + 5] = cars.action[car, 0]
    state[rays + 6] = cars.action[car, 1]
    for place in range(sight.ahead.size):
        curvature = curvature_ahead(lanes, lane, longitudinal, sight.ahead[place])
        state[rays + 7 + place] = curvature * sight.curvature_scale
    along, against = math.cos(error), math.sin(error)
    straying = 2 * forward * abs(offset * against)
    return forward * along - abs(sideways * against) - straying - sideways * along


@_compiled
def drive(cars: Cars, which: NDArray[np.int64], motion: Motion) -> None:
    """Drive the cars `which` (k,) for one decision, by the actions that were set."""
    for car in which:
        _drive(cars, car, motion)


@_compiled
def place(cars: Cars, which: NDArray[np.int64], starts: Floats, lanes: Lanes) -> None:
    """Put the cars `which` (k,) at starts (k, 3): row of the lane, metres along it, speed."""
    for number in range(which.size):
        car, row = which[number], int(starts[number, 0])
        longitudinal = starts[number, 1]
        if lanes.turn[row] == 0:
            cars.pose[car, 0] = lanes.x[row] + longitudinal * lanes.along_x[row]
            cars.pose[car, 1] = lanes.y[row] + longitudinal * lanes.along_y[row]
        else:
            phase = lanes.turn[row] * longitudinal / lanes.radius[row] + lanes.phase[row]
            cars.pose[car, 0] = lanes.x[row] + lanes.radius[row] * math.cos(phase)
            cars.pose[car, 1] = lanes.y[row] + lanes.radius[row] * math.sin(phase)
        cars.pose[car, 2] = _heading_at(lanes, row, longitudinal)
        cars.pose[car, 3] = starts[number, 2]
        cars.action[car] = 0.0
        cars.slip[car] = 0.0


@_compiled
def see(
    cars: Cars,
    which: NDArray[np.int64],
    angles: Floats,
    lanes: Lanes,
    edges: Edges,
    sight: Sight,
    motion: Motion,
    states: Floats,
    rewards: Floats,
    off_road: NDArray[np.bool_],
) -> None:
    """Find the lanes of the cars `which` (k,), and write what they see and are worth.

    angles (k, lanes) are those of the cars from the lanes' x, y. Writes rows of states (n, 29),
    rewards (n,) and off_road (n,): whether the middle of the car is beyond an edge.
    """
    for number in range(which.size):
        car = which[number]
        _locate(cars, car, lanes, angles[number])
        rewards[car] = _observe(cars, car, lanes, edges, sight, motion, states[car])
        lane = cars.lane[car]
        off = abs(cars.local[car, 1] + lanes.axis_offset[lane])
        off_road[car] = off > lanes.half_width[lane]
