"""The RC world's inner loops, compiled: rays among walls, the bicycle, the noise.

One file, because numba's cache notices a change of a file, but not of what it imports.
Everything is a pure function of its arguments except `place` and `drive`, which write `Cars`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray


class Grid(NamedTuple):
    """Straight walls, sorted into square cells of side `cell` [m] from the corner `low` (x, y).

    The walls of cell (i, j) are the rows first[k] to first[k + 1] of `walls` (m, 4), k = i *
    shape[1] + j: x and y of the start, x and y from start to end. A wall of several cells stands
    in `walls` several times.
    """

    low: NDArray[np.float64]
    cell: float
    shape: NDArray[np.int64]
    first: NDArray[np.int64]
    walls: NDArray[np.float64]


class World(NamedTuple):
    """All numbers that a step needs, in metres, seconds and radians.

    starts (m, 3): x, y, heading along the lap; beams (b, 2): cosine and
    sine of their angles off the car's axis; the car
    is a rectangle from `rear` to `front` of the rear axle, `half` to each side.
    """

    grid: Grid
    starts: NDArray[np.float64]
    beams: NDArray[np.float64]
    reach: float
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
    """What changes, one row per car: pose (n, 3) of the rear axle, angle (n,) of the wheels,
    steering (n,) asked for last, key (n,) and episode (n,) of the randomness, steps (n,) driven.
    """

    pose: NDArray[np.float64]
    wheels: NDArray[np.float64]
    steering: NDArray[np.float64]
    key: NDArray[np.uint64]
    episode: NDArray[np.int64]
    steps: NDArray[np.int64]


_TOUCH = 1e-9
"""Slack at the ends of a wall: a ray through a joint must hit one of its two sides."""
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_SHIFT = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_START_DRAWS = 3


@njit(cache=True)
def bits(key: Any, number: Any) -> Any:
    """Return random bits by number: SplitMix64 (Steele, Lea, Flood 2014) as a hash."""
    mixed = key + (np.uint64(number) + np.uint64(1)) * _GOLDEN
    mixed = (mixed ^ (mixed >> _SHIFT[0])) * _MIX[0]
    mixed = (mixed ^ (mixed >> _SHIFT[1])) * _MIX[1]
    return mixed ^ (mixed >> _SHIFT[2])


@njit(cache=True)
def uniform(key: Any, number: Any) -> Any:
    """Return a number in (0, 1)."""
    return (np.float64(bits(key, number) >> _SHIFT[3]) + 0.5) * 2.0**-53


@njit(cache=True)
def cast(grid: Any, x: float, y: float, cos: float, sin: float, reach: float) -> float:
    """Return how far the ray runs before it meets a wall, at most `reach`; exact.

    Walks the cells that the ray crosses (Amanatides, Woo 1987) and cuts it with their walls.
    """
    low, size, shape = grid.low, grid.cell, grid.shape
    i, j = int((x - low[0]) // size), int((y - low[1]) // size)
    if i < 0 or j < 0 or i >= shape[0] or j >= shape[1]:
        return reach
    step_i, step_j = (1 if cos > 0 else -1), (1 if sin > 0 else -1)
    width = abs(size / cos) if cos != 0 else np.inf
    height = abs(size / sin) if sin != 0 else np.inf
    next_x = (low[0] + (i + (cos > 0)) * size - x) / cos if cos != 0 else np.inf
    next_y = (low[1] + (j + (sin > 0)) * size - y) / sin if sin != 0 else np.inf
    nearest = reach
    while True:
        k = i * shape[1] + j
        for row in range(grid.first[k], grid.first[k + 1]):
            wall = grid.walls[row]
            from_x, from_y = wall[0] - x, wall[1] - y
            across = cos * wall[3] - sin * wall[2]
            share = from_x * sin - from_y * cos
            distance = from_x * wall[3] - from_y * wall[2]
            if across < 0:
                across, share, distance = -across, -share, -distance
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
def fan(
    grid: Any, x: float, y: float, heading: float, beams: Any, reach: float, ranges: Any
) -> None:
    """Write the range [m] of every beam; beams (b, 2): cosine and sine of its angle."""
    ahead, aside = np.cos(heading), np.sin(heading)
    for beam in range(len(beams)):
        cos, sin = beams[beam]
        ranges[beam] = cast(grid, x, y, ahead * cos - aside * sin, aside * cos + ahead * sin, reach)


@njit(cache=True)
def fans(grid: Any, poses: Any, beams: Any, reach: float, ranges: Any) -> None:
    """Write the ranges (n, b) of every beam from every pose (n, 3)."""
    for row in range(len(poses)):
        fan(grid, poses[row, 0], poses[row, 1], poses[row, 2], beams, reach, ranges[row])


@njit(cache=True)
def touches(world: Any, x: float, y: float, heading: float) -> bool:
    """Tell whether a side of the car's rectangle crosses a wall."""
    cos, sin = np.cos(heading), np.sin(heading)
    length, width = world.front - world.rear, 2 * world.half
    for side in (-1.0, 1.0):
        behind_x = x + world.rear * cos - side * world.half * sin
        behind_y = y + world.rear * sin + side * world.half * cos
        if cast(world.grid, behind_x, behind_y, cos, sin, length) < length:
            return True
        end = world.front if side > 0 else world.rear
        right_x = x + end * cos + world.half * sin
        right_y = y + end * sin - world.half * cos
        if cast(world.grid, right_x, right_y, -sin, cos, width) < width:
            return True
    return False


@njit(cache=True)
def find_blocked_start(world: Any, turns: Any) -> int:
    """Return the first row of starts where a car could begin in a wall, or beyond one; or -1.

    Tried on both sides as far aside as a start may be, and at the angles turns (t,). What the line
    sees all corners of, and no wall crosses the sides of, is free: also a car larger than the map.
    """
    for row in range(len(world.starts)):
        line_x, line_y, along = world.starts[row]
        for aside in (-world.aside, world.aside):
            x, y = line_x - aside * np.sin(along), line_y + aside * np.cos(along)
            for turn in turns:
                if touches(world, x, y, along + turn):
                    return row
                cos, sin = np.cos(along + turn), np.sin(along + turn)
                for ahead in (world.rear, world.front):
                    for left in (-world.half, world.half):
                        away_x = x + ahead * cos - left * sin - line_x
                        away_y = y + ahead * sin + left * cos - line_y
                        far = np.hypot(away_x, away_y)
                        if far > 0:
                            way_x, way_y = away_x / far, away_y / far
                            if cast(world.grid, line_x, line_y, way_x, way_y, far) < far:
                                return row
    return -1


@njit(cache=True)
def observe(world: Any, cars: Any, car: int, state: Any) -> None:
    """Write what the car sees: noisy ranges as a share of the reach, the previous steering."""
    x, y, heading = cars.pose[car]
    x, y = x + world.lidar * np.cos(heading), y + world.lidar * np.sin(heading)
    fan(world.grid, x, y, heading, world.beams, world.reach, state)
    key, beams = bits(cars.key[car], cars.episode[car]), len(world.beams)
    first = _START_DRAWS + cars.steps[car] * (beams + 1)
    radius, turn = 0.0, 0.0
    for beam in range(beams):
        if beam % 2 == 0:  # Box and Muller's pair of normal numbers
            radius = np.sqrt(-2.0 * np.log(uniform(key, first + beam)))
            turn = 2.0 * np.pi * uniform(key, first + beam + 1)
        normal = radius * (np.cos(turn) if beam % 2 == 0 else np.sin(turn))
        far = state[beam]
        if far < world.reach:
            far = min(max(far * (1.0 + world.noise * normal), 0.0), world.reach)
        state[beam] = far / world.reach
    state[beams] = cars.steering[car]


@njit(cache=True)
def place(world: Any, cars: Any, car: int) -> None:
    """Begin the car's next episode: anywhere on the lap, a little aside and askew."""
    cars.episode[car] += 1
    key = bits(cars.key[car], cars.episode[car])
    x, y, heading = world.starts[int(uniform(key, 0) * len(world.starts))]
    aside = world.aside * (2.0 * uniform(key, 1) - 1.0)
    cars.pose[car, 0] = x - aside * np.sin(heading)
    cars.pose[car, 1] = y + aside * np.cos(heading)
    cars.pose[car, 2] = heading + world.askew * (2.0 * uniform(key, 2) - 1.0)
    cars.wheels[car] = cars.steering[car] = 0.0
    cars.steps[car] = 0


@njit(cache=True)
def drive(world: Any, cars: Any, car: int, action: float) -> bool:
    """Drive one car for one period; return whether it hit a wall, where it then stands.

    The wheels follow the asked angle with a first-order lag, exactly; the rear axle follows the
    kinematic bicycle with the angle that the wheels have at the end of each substep.
    """
    steering = min(max(action, -1.0), 1.0)
    tick = world.period / world.substeps
    keep = np.exp(-tick / world.lag) if world.lag > 0 else 0.0
    asked, ahead = steering * world.steering, world.speed * tick
    x, y, heading = cars.pose[car]
    wheels, hit = cars.wheels[car], False
    for _ in range(world.substeps):
        wheels = asked + (wheels - asked) * keep
        turn = ahead * np.tan(wheels) / world.wheelbase
        x += ahead * np.cos(heading + turn / 2)
        y += ahead * np.sin(heading + turn / 2)
        heading += turn
        if touches(world, x, y, heading):
            hit = True
            break
    cars.pose[car, 0], cars.pose[car, 1] = x, y
    cars.pose[car, 2] = (heading + np.pi) % (2 * np.pi) - np.pi
    cars.wheels[car], cars.steering[car] = wheels, steering
    cars.steps[car] += 1
    return hit


@njit(cache=True)
def begin(world: Any, cars: Any, which: Any, states: Any) -> None:
    """Begin the next episode of the cars of which (n,) is true, and write what they see."""
    for car in range(len(which)):
        if which[car]:
            place(world, cars, car)
            observe(world, cars, car, states[car])


@njit(cache=True)
def advance(world: Any, cars: Any, which: Any, actions: Any, states: Any, hits: Any) -> None:
    """Drive the cars of which (n,) is true for one period; write what they see and who hit."""
    for car in range(len(which)):
        hits[car] = False
        if which[car]:
            hits[car] = drive(world, cars, car, actions[car])
            observe(world, cars, car, states[car])


@njit(cache=True)
def sort_into_cells(segments: Any, grid: Any, first: Any, rows: Any) -> None:
    """Count the walls of every cell into first (cells + 1,), or list them where rows is not empty.

    segments (n, 4): x, y of start and end. A wall belongs to the cells that it touches, and to
    neighbours within a hair.
    """
    low, size, shape = grid.low, grid.cell, grid.shape
    slack = 1e-6 * size
    for row in range(len(segments)):
        x0, y0, x1, y1 = segments[row]
        along_x, along_y = x1 - x0, y1 - y0
        i0, i1 = (
            int((min(x0, x1) - low[0] - slack) // size),
            int((max(x0, x1) - low[0] + slack) // size),
        )
        j0, j1 = (
            int((min(y0, y1) - low[1] - slack) // size),
            int((max(y0, y1) - low[1] + slack) // size),
        )
        for i in range(max(i0, 0), min(i1, shape[0] - 1) + 1):
            for j in range(max(j0, 0), min(j1, shape[1] - 1) + 1):
                from_x, from_y = low[0] + (i + 0.5) * size - x0, low[1] + (j + 0.5) * size - y0
                off_line = abs(along_x * from_y - along_y * from_x)
                if off_line <= (abs(along_x) + abs(along_y)) * (size / 2 + slack):
                    k = i * shape[1] + j
                    if len(rows):
                        rows[first[k]] = row
                        first[k] += 1
                    else:
                        first[k + 1] += 1
