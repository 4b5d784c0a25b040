"""The RC world's inner loops, compiled: rays among walls, the bicycle, the noise.

They stand in one file, because numba's cache notices a change of a file, but not of what it
imports. Everything is a pure function of its arguments except what writes `Cars`, `Output` or
ranges, which says so.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray


class Grid(NamedTuple):
    """Straight walls, sorted into square cells.

    Parameters
    ----------
    low:
        x, y of the grid's lower left corner [m] (2,).
    cell:
        Side of a cell [m].
    shape:
        Number of cells along x and y (2,).
    first:
        The walls of cell (i, j) are the rows first[k] to first[k + 1] of `walls`, where
        k = i * shape[1] + j (cells + 1,).
    walls:
        x, y of the start, and x, y from start to end [m] (m, 4). A wall of several cells stands
        here several times.
    """

    low: NDArray[np.float64]
    cell: float
    shape: NDArray[np.int64]
    first: NDArray[np.int64]
    walls: NDArray[np.float64]


class Beams(NamedTuple):
    """The beams of a LiDAR.

    Parameters
    ----------
    directions:
        Cosine and sine of each beam's angle off the heading, left positive (b, 2).
    reach:
        Greatest range [m].
    """

    directions: NDArray[np.float64]
    reach: float


class World(NamedTuple):
    """All numbers that a step needs, in meters, seconds and radians.

    Parameters
    ----------
    grid:
        The walls.
    starts:
        x, y and heading of places along the lap (m, 3).
    beams:
        The LiDAR's beams.
    noise:
        Deviation of the normal noise on a range, as a share of it.
    lidar:
        How far the LiDAR is ahead of the rear axle [m].
    rear, front, half:
        The car's rectangle: from `rear` to `front` of the rear axle, `half` to each side [m].
    wheelbase:
        From rear axle to front axle [m].
    speed:
        Speed of the rear axle [m/s].
    steering:
        Angle of the wheels at full steering [rad].
    lag:
        Time constant of the wheels' angle [s].
    period, substeps:
        Duration of a decision [s], and how many steps of the simulation it has.
    aside, askew:
        Greatest distance and angle of a start from the center line [m, rad].
    """

    grid: Grid
    starts: NDArray[np.float64]
    beams: Beams
    noise: float
    lidar: float
    rear: float
    front: float
    half: float
    wheelbase: float
    speed: float
    steering: float
    lag: float
    period: float
    substeps: int
    aside: float
    askew: float


class Cars(NamedTuple):
    """What changes while n cars drive.

    Parameters
    ----------
    pose:
        x, y [m] and heading [rad] of the rear axle (n, 3).
    wheels:
        Angle of the front wheels [rad] (n,).
    steering:
        Last action in [-1, 1] (n,).
    key, episode:
        Randomness: the seed's hash, and the number of the episode (n,).
    steps:
        Decisions since the start of the episode (n,).
    """

    pose: NDArray[np.float64]
    wheels: NDArray[np.float64]
    steering: NDArray[np.float64]
    key: NDArray[np.uint64]
    episode: NDArray[np.int64]
    steps: NDArray[np.int64]

    @classmethod
    def allocate(cls, count: int) -> Cars:
        """Return room for cars that are nowhere yet.

        Parameters
        ----------
        count:
            Number of cars.
        """
        return cls(
            pose=np.zeros((count, 3)),
            wheels=np.zeros(count),
            steering=np.zeros(count),
            key=np.zeros(count, dtype=np.uint64),
            episode=np.full(count, -1),
            steps=np.zeros(count, dtype=np.int64),
        )


class Output(NamedTuple):
    """What a step of n cars writes.

    Parameters
    ----------
    states:
        Ranges as shares of the reach, and the previous steering (n, b + 1).
    hits:
        Whether the car hit a wall (n,).
    """

    states: NDArray[np.float64]
    hits: NDArray[np.bool_]


_TOUCH = 1e-9
"""Slack at the ends of a wall: a ray through a joint must hit one of its two sides."""
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_SHIFT = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_START_DRAWS = 3
"""Numbers 0 to 2 of an episode draw its start; the noise begins after them."""


@njit(cache=True)
def hash_bits(key: Any, number: Any) -> Any:
    """Return the random bits with a number: SplitMix64 as a hash, so that none are stored.

    Parameters
    ----------
    key:
        uint64 that tells one stream of bits from another.
    number:
        Place in the stream, from 0.

    Returns
    -------
    uint64
        The bits.

    Source
    ------
    Steele, Lea, Flood: Fast splittable pseudorandom number generators, 2014.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.kernels import hash_bits
    >>> hash_bits(np.uint64(1), 0) == hash_bits(np.uint64(1), 1)
    False
    """
    mixed = key + (np.uint64(number) + np.uint64(1)) * _GOLDEN
    mixed = (mixed ^ (mixed >> _SHIFT[0])) * _MIX[0]
    mixed = (mixed ^ (mixed >> _SHIFT[1])) * _MIX[1]
    return mixed ^ (mixed >> _SHIFT[2])


@njit(cache=True)
def draw_uniform(key: Any, number: Any) -> Any:
    """Return the uniform random number in (0, 1) with a number.

    Parameters
    ----------
    key, number:
        As for `hash_bits`.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.kernels import draw_uniform
    >>> 0.0 < draw_uniform(np.uint64(1), 0) < 1.0
    True
    """
    return (np.float64(hash_bits(key, number) >> _SHIFT[3]) + 0.5) * 2.0**-53


class Ray(NamedTuple):
    """A ray from (x, y) [m] in the direction (cos, sin)."""

    x: float
    y: float
    cos: float
    sin: float


@njit(cache=True)
def cast_ray(grid: Any, ray: Any, reach: float) -> float:
    """Return how far a ray runs before it meets a wall, exact to rounding.

    It walks the cells that the ray crosses and cuts it with their walls.

    Parameters
    ----------
    grid:
        The walls (`Grid`).
    ray:
        Where it begins and where it goes (`Ray`).
    reach:
        Greatest length [m].

    Returns
    -------
    float
        Length [m], at most `reach`; `reach` from outside of the grid.

    Source
    ------
    Amanatides, Woo: A fast voxel traversal algorithm for ray tracing, 1987.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.kernels import Ray, cast_ray
    >>> from ssil_trainers.envs.rc_lidar.lidar import Walls
    >>> wall = Walls.from_segments([[2, -1, 2, 1], [-1, -1, -1, 1]])
    >>> cast_ray(wall.grid, Ray(0.0, 0.0, 1.0, 0.0), 9.0)
    2.0
    """
    x, y, cos, sin = ray
    low = grid.low
    size = grid.cell
    shape = grid.shape
    i = int((x - low[0]) // size)
    j = int((y - low[1]) // size)
    if i < 0 or j < 0 or i >= shape[0] or j >= shape[1]:
        return reach
    step_i = 1 if cos > 0 else -1
    step_j = 1 if sin > 0 else -1
    width = abs(size / cos) if cos != 0 else np.inf
    height = abs(size / sin) if sin != 0 else np.inf
    next_x = (low[0] + (i + (cos > 0)) * size - x) / cos if cos != 0 else np.inf
    next_y = (low[1] + (j + (sin > 0)) * size - y) / sin if sin != 0 else np.inf
    nearest = reach
    while True:
        k = i * shape[1] + j
        for row in range(grid.first[k], grid.first[k + 1]):
            wall = grid.walls[row]
            from_x = wall[0] - x
            from_y = wall[1] - y
            across = cos * wall[3] - sin * wall[2]
            share = from_x * sin - from_y * cos
            distance = from_x * wall[3] - from_y * wall[2]
            if across < 0:
                across = -across
                share = -share
                distance = -distance
            slack = _TOUCH * across
            # Both are still multiplied by `across`: dividing only what is hit is faster.
            if 0 <= distance < nearest * across and -slack <= share <= across + slack:
                nearest = distance / across
        leaves = min(next_x, next_y)
        if nearest <= leaves:
            return nearest
        if next_x < next_y:
            i += step_i
            next_x += width
        else:
            j += step_j
            next_y += height
        if i < 0 or j < 0 or i >= shape[0] or j >= shape[1]:
            return nearest


@njit(cache=True)
def scan_pose(grid: Any, pose: Any, beams: Any, ranges: Any) -> None:
    """Write the range of every beam from one pose.

    Parameters
    ----------
    grid:
        The walls (`Grid`).
    pose:
        x, y [m] and heading [rad] (3,).
    beams:
        Directions and reach (`Beams`).
    ranges:
        Where the ranges are written [m] (b,).
    """
    x, y, heading = pose
    ahead = np.cos(heading)
    aside = np.sin(heading)
    for beam in range(len(beams.directions)):
        cos, sin = beams.directions[beam]
        ray = Ray(x, y, ahead * cos - aside * sin, aside * cos + ahead * sin)
        ranges[beam] = cast_ray(grid, ray, beams.reach)


@njit(cache=True)
def scan_poses(grid: Any, poses: Any, beams: Any, ranges: Any) -> None:
    """Write the range of every beam from every pose.

    Parameters
    ----------
    grid:
        The walls (`Grid`).
    poses:
        x, y [m] and heading [rad] (n, 3).
    beams:
        Directions and reach (`Beams`).
    ranges:
        Where the ranges are written [m] (n, b).
    """
    for row in range(len(poses)):
        pose = (poses[row, 0], poses[row, 1], poses[row, 2])
        scan_pose(grid, pose, beams, ranges[row])


@njit(cache=True)
def touches_wall(world: Any, x: float, y: float, heading: float) -> bool:
    """Tell whether a side of the car's rectangle crosses a wall.

    Parameters
    ----------
    world:
        Walls and car (`World`).
    x, y, heading:
        Pose of the rear axle [m, rad].
    """
    cos = np.cos(heading)
    sin = np.sin(heading)
    length = world.front - world.rear
    width = 2 * world.half
    for side in (-1.0, 1.0):
        # One long side, forwards from the rear.
        behind_x = x + world.rear * cos - side * world.half * sin
        behind_y = y + world.rear * sin + side * world.half * cos
        if cast_ray(world.grid, Ray(behind_x, behind_y, cos, sin), length) < length:
            return True
        # One short side, from right to left: the front bumper or the rear one.
        end = world.front if side > 0 else world.rear
        right_x = x + end * cos + world.half * sin
        right_y = y + end * sin - world.half * cos
        if cast_ray(world.grid, Ray(right_x, right_y, -sin, cos), width) < width:
            return True
    return False


@njit(cache=True)
def find_blocked_start(world: Any, turns: Any) -> int:
    """Return the first row of starts where a car could begin in a wall, or beyond one; or -1.

    A start is tried on both sides as far aside as it may be. It is free if the center line sees
    all corners of the car and no wall crosses its sides, however large the car is.

    Parameters
    ----------
    world:
        Walls, starts and car (`World`).
    turns:
        Angles to the center line that are tried [rad] (t,).
    """
    for row in range(len(world.starts)):
        line_x, line_y, along = world.starts[row]
        for aside in (-world.aside, world.aside):
            x = line_x - aside * np.sin(along)
            y = line_y + aside * np.cos(along)
            for turn in turns:
                if touches_wall(world, x, y, along + turn):
                    return row
                cos = np.cos(along + turn)
                sin = np.sin(along + turn)
                for ahead in (world.rear, world.front):
                    for left in (-world.half, world.half):
                        away_x = x + ahead * cos - left * sin - line_x
                        away_y = y + ahead * sin + left * cos - line_y
                        far = np.hypot(away_x, away_y)
                        if far > 0:
                            to_corner = Ray(line_x, line_y, away_x / far, away_y / far)
                            if cast_ray(world.grid, to_corner, far) < far:
                                return row
    return -1


@njit(cache=True)
def observe_car(world: Any, cars: Any, car: int, state: Any) -> None:
    """Write what a car sees: noisy ranges as shares of the reach, and the previous steering.

    Parameters
    ----------
    world:
        Walls and car (`World`).
    cars:
        All cars (`Cars`).
    car:
        Row of the car.
    state:
        Where its state is written (b + 1,).
    """
    x, y, heading = cars.pose[car]
    reach = world.beams.reach
    pose = (x + world.lidar * np.cos(heading), y + world.lidar * np.sin(heading), heading)
    scan_pose(world.grid, pose, world.beams, state)
    key = hash_bits(cars.key[car], cars.episode[car])
    beams = len(world.beams.directions)
    first = _START_DRAWS + cars.steps[car] * (beams + 1)
    radius = 0.0
    turn = 0.0
    for beam in range(beams):
        if beam % 2 == 0:  # Box and Muller's pair of normal numbers
            radius = np.sqrt(-2.0 * np.log(draw_uniform(key, first + beam)))
            turn = 2.0 * np.pi * draw_uniform(key, first + beam + 1)
        normal = radius * (np.cos(turn) if beam % 2 == 0 else np.sin(turn))
        far = state[beam]
        if far < reach:
            far = min(max(far * (1.0 + world.noise * normal), 0.0), reach)
        state[beam] = far / reach
    state[beams] = cars.steering[car]


@njit(cache=True)
def place_car(world: Any, cars: Any, car: int) -> None:
    """Begin a car's next episode: anywhere on the lap, a little aside and askew.

    Parameters
    ----------
    world:
        Starts and how far from them (`World`).
    cars:
        All cars (`Cars`); the car's row is written.
    car:
        Row of the car.
    """
    cars.episode[car] += 1
    key = hash_bits(cars.key[car], cars.episode[car])
    x, y, heading = world.starts[int(draw_uniform(key, 0) * len(world.starts))]
    aside = world.aside * (2.0 * draw_uniform(key, 1) - 1.0)
    cars.pose[car, 0] = x - aside * np.sin(heading)
    cars.pose[car, 1] = y + aside * np.cos(heading)
    cars.pose[car, 2] = heading + world.askew * (2.0 * draw_uniform(key, 2) - 1.0)
    cars.wheels[car] = 0.0
    cars.steering[car] = 0.0
    cars.steps[car] = 0


@njit(cache=True)
def drive_car(world: Any, cars: Any, car: int, action: float) -> bool:
    """Drive one car for one period; return whether it hit a wall, where it then stands.

    The wheels follow the angle of the action with a first-order lag, exactly; the rear axle follows
    the kinematic bicycle with the angle that the wheels have at the end of each substep.

    Parameters
    ----------
    world:
        Walls and car (`World`).
    cars:
        All cars (`Cars`); the car's row is written.
    car:
        Row of the car.
    action:
        Steering; what is beyond [-1, 1] is clipped.
    """
    steering = min(max(action, -1.0), 1.0)
    tick = world.period / world.substeps
    keep = np.exp(-tick / world.lag) if world.lag > 0 else 0.0
    target = steering * world.steering
    ahead = world.speed * tick
    x, y, heading = cars.pose[car]
    wheels = cars.wheels[car]
    hit = False
    for _ in range(world.substeps):
        wheels = target + (wheels - target) * keep
        turn = ahead * np.tan(wheels) / world.wheelbase
        x += ahead * np.cos(heading + turn / 2)
        y += ahead * np.sin(heading + turn / 2)
        heading += turn
        if touches_wall(world, x, y, heading):
            hit = True
            break
    cars.pose[car, 0] = x
    cars.pose[car, 1] = y
    cars.pose[car, 2] = (heading + np.pi) % (2 * np.pi) - np.pi
    cars.wheels[car] = wheels
    cars.steering[car] = steering
    cars.steps[car] += 1
    return hit


@njit(cache=True)
def begin_episodes(world: Any, cars: Any, which: Any, states: Any) -> None:
    """Begin the next episode of some cars, and write what they see.

    Parameters
    ----------
    world:
        Walls and car (`World`).
    cars:
        All cars (`Cars`); rows are written.
    which:
        True for the cars to place (n,).
    states:
        Where their states are written (n, b + 1).
    """
    for car in range(len(which)):
        if which[car]:
            place_car(world, cars, car)
            observe_car(world, cars, car, states[car])


@njit(cache=True)
def drive_cars(world: Any, cars: Any, which: Any, actions: Any, output: Any) -> None:
    """Drive some cars for one period; write what they see and which of them hit a wall.

    Parameters
    ----------
    world:
        Walls and car (`World`).
    cars:
        All cars (`Cars`); rows are written.
    which:
        True for the cars to drive (n,).
    actions:
        Steering of every car (n,).
    output:
        Where states and hits are written (`Output`).
    """
    for car in range(len(which)):
        output.hits[car] = False
        if which[car]:
            output.hits[car] = drive_car(world, cars, car, actions[car])
            observe_car(world, cars, car, output.states[car])


@njit(cache=True)
def sort_into_cells(segments: Any, grid: Any, first: Any, rows: Any) -> None:
    """Count the walls of every cell, or list them: the two passes of a counting sort.

    A wall belongs to the cells that it touches, and to neighbors within a hair.

    Parameters
    ----------
    segments:
        Walls, x, y of start and end [m] (n, 4).
    grid:
        Where the cells are (`Grid`).
    first:
        First pass: counts of cell k are added at k + 1. Second pass: place of the next wall of
        cell k in `rows`, which moves on (cells + 1,).
    rows:
        Empty in the first pass. Second pass: where the rows of the walls are written.
    """
    low = grid.low
    size = grid.cell
    shape = grid.shape
    slack = 1e-6 * size
    for row in range(len(segments)):
        x0, y0, x1, y1 = segments[row]
        along_x = x1 - x0
        along_y = y1 - y0
        i0 = int((min(x0, x1) - low[0] - slack) // size)
        i1 = int((max(x0, x1) - low[0] + slack) // size)
        j0 = int((min(y0, y1) - low[1] - slack) // size)
        j1 = int((max(y0, y1) - low[1] + slack) // size)
        for i in range(max(i0, 0), min(i1, shape[0] - 1) + 1):
            for j in range(max(j0, 0), min(j1, shape[1] - 1) + 1):
                from_x = low[0] + (i + 0.5) * size - x0
                from_y = low[1] + (j + 0.5) * size - y0
                off_line = abs(along_x * from_y - along_y * from_x)
                if off_line <= (abs(along_x) + abs(along_y)) * (size / 2 + slack):
                    k = i * shape[1] + j
                    if len(rows):
                        rows[first[k]] = row
                        first[k] += 1
                    else:
                        first[k + 1] += 1
