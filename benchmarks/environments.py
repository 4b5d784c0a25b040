"""How many steps a second do the driving environments make on one core, beside their peers?

Every row drives in turns with the others, round by round; only resets and steps are timed, in
processor time, with one thread. Steps count cars: a step of 64 cars is 64. The table gives medians
and the ratio to each peer of the same world. Then: how long a fresh process takes to its first
state, with the code compiled anew and with the compiled code on disk.
"""

from __future__ import annotations

import os

os.environ |= {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}  # before NumPy and numba load

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from rivals.plain_racetrack import PlainRacetrack
from rivals.raycast import draw_poses, find_scanners, scan_many

import ssil_trainers.envs  # noqa: F401  registers the ids

ROUNDS = 9
SECONDS = 0.4
"""Processor time of a row in one round."""
MANY = "our rays, center line, 2,000 scans in one call"

Driver = Callable[[np.ndarray], np.ndarray]
"""From states (n, d) to actions (n, k); its time does not count."""


@dataclass
class Row:
    """Some cars that drive on from round to round."""

    name: str
    make: Callable[[], Any]
    driver: Driver
    cars: int | None = None
    """None: one car in a single environment, which is reset by hand."""

    def __post_init__(self) -> None:
        """Start, and compile what there is to compile."""
        self.envs = self.make()
        self.state, _ = self.envs.reset(seed=0)
        self.rate(0.01)

    def rate(self, seconds: float) -> float:
        """Drive for so many seconds of processor time; return the steps a second."""
        steps = 0
        spent = 0.0
        while spent < seconds:
            actions = self.driver(np.atleast_2d(self.state))
            actions = actions if self.cars else actions[0]
            begin = time.process_time()
            self.state, _, ended, cut, _ = self.envs.step(actions)
            if self.cars is None and (ended or cut):
                self.state, _ = self.envs.reset()
            spent += time.process_time() - begin
            steps += self.cars or 1
        return steps / spent


@dataclass(frozen=True)
class World:
    """Rows to compare, and the names of those that the others are measured by."""

    title: str
    rows: Sequence[Row]
    peers: Sequence[str]


def racetrack() -> World:
    """Return the racetrack: the twin, the real environment, and highway-env's task as it comes.

    The plainest highway-env loop with the same observation is the one whose rays NumPy casts.
    """

    def twin(cars: int) -> Row:
        make = partial(
            gymnasium.make_vec, "SSILRacetrack-v0", cars, autoreset_mode=AutoresetMode.SAME_STEP
        )
        return Row(f"twin, {cars:,} cars", make, drive_carefully, cars)

    return World(
        "racetrack, default track, 10 Hz",
        [
            twin(1),
            twin(64),
            twin(1_024),
            Row("real environment", _single, drive_carefully),
            Row("real, rays by plain NumPy", PlainRacetrack, drive_carefully),
            Row("racetrack-v1 as it comes", partial(gymnasium.make, "racetrack-v1"), _drift),
        ],
        ["real environment", "real, rays by plain NumPy"],
    )


def rc_lidar() -> World:
    """Return the RC car: the fleet beside the single environment, which is a fleet of one."""

    def fleet(cars: int) -> Row:
        make = partial(
            gymnasium.make_vec, "RCLidar-v0", cars, autoreset_mode=AutoresetMode.SAME_STEP
        )
        return Row(f"fleet, {cars:,} cars", make, _aim, cars)

    def single() -> gymnasium.Env[Any, Any]:
        return gymnasium.make("RCLidar-v0").unwrapped

    return World(
        "RC LiDAR car, training track, 10 Hz",
        [fleet(1), fleet(64), fleet(1_024), Row("single environment", single, _aim)],
        ["single environment"],
    )


def _aim(states: np.ndarray) -> np.ndarray:
    """Steer to the side where the beams reach farther, with some noise, which ends laps."""
    left = states[:, 11:15].mean(axis=1)
    right = states[:, 4:8].mean(axis=1)
    steering = 3 * (left - right) + _NOISE.normal(scale=0.1, size=len(states))
    return steering[:, None].astype(np.float32)


def drive_carefully(states: np.ndarray) -> np.ndarray:
    """Keep to the middle and brake for curves, with some noise, which ends some episodes."""
    heading = states[:, 19]
    offset = states[:, 20]
    speed = 20 * states[:, 21]
    slip = np.arcsin(np.clip(2.5 * states[:, 26] / 20, -0.9, 0.9))
    curve = np.arctan(2 * np.tan(slip)) / (np.pi / 4)
    tightest = np.abs(states[:, 26:]).max(axis=1) / 20
    wanted = np.minimum(19.0, np.sqrt(6 / np.maximum(tightest, 1e-3)))
    steering = curve - (heading + 0.25 * offset) * 10 / np.maximum(speed, 5.0)
    actions = np.stack([(wanted - speed) / 2, steering], axis=1)
    return (actions + _NOISE.normal(scale=0.3, size=actions.shape)).astype(np.float32)


_NOISE = np.random.default_rng(0)


def _drift(states: np.ndarray) -> np.ndarray:
    return _NOISE.uniform(-0.1, 0.1, (1, 1)).astype(np.float32)


def _single() -> gymnasium.Env[Any, Any]:
    return gymnasium.make("SSILRacetrack-v0").unwrapped


def print_speeds(world: World) -> None:
    """Print one row for each of the world's."""
    rates: dict[str, list[float]] = {row.name: [] for row in world.rows}
    for _ in range(ROUNDS):
        for row in world.rows:
            rates[row.name].append(row.rate(SECONDS))
    median = {name: statistics.median(found) for name, found in rates.items()}
    print(f"{world.title}: medians of {ROUNDS} interleaved rounds, one core")
    print(f"{'':>28}{'steps/s':>10}" + "".join(f"{'× ' + peer:>28}" for peer in world.peers))
    for name, rate in median.items():
        ratios = "".join(f"{rate / median[peer]:>28.3g}" for peer in world.peers)
        print(f"{name:>28}{rate:>10,.0f}{ratios}")


def print_scans() -> None:
    """Print the microseconds of one scan of 19 beams: one call for each, and many in one call."""
    places = draw_poses()
    ways = find_scanners()
    spent: dict[str, list[float]] = {name: [] for name in [*ways, MANY]}
    for scan in ways.values():
        scan(places[0])
    for _ in range(ROUNDS):
        for name, scan in ways.items():
            begin = time.process_time()
            for place in places:
                scan(place)
            spent[name].append(1e6 * (time.process_time() - begin) / len(places))
        begin = time.process_time()
        scan_many(places)
        spent[MANY].append(1e6 * (time.process_time() - begin) / len(places))
    print(
        "one scan of 19 beams, training track, reach 10 m, µs: "
        + ", ".join(f"{name} {statistics.median(times):.1f}" for name, times in spent.items())
    )


def print_starts(env_id: str) -> None:
    """Print the seconds from a fresh process to the first state of 64 cars."""
    begin_to_state = (
        "import time; begin = time.perf_counter(); import gymnasium, ssil_trainers.envs; "
        f"gymnasium.make_vec({env_id!r}, num_envs=64).reset(seed=0); "
        "print(time.perf_counter() - begin)"
    )
    with tempfile.TemporaryDirectory() as cache:
        place = os.environ | {"NUMBA_CACHE_DIR": cache}
        first, *later = (
            float(subprocess.check_output([sys.executable, "-c", begin_to_state], env=place))
            for _ in range(4)
        )
    median = statistics.median(later)
    print(f"{env_id}: {first:.1f} s to the first state, compiled anew; {median:.1f} s after")


def main() -> None:
    """Print a table for each world."""
    for world, env_id in ((racetrack, "SSILRacetrack-v0"), (rc_lidar, "RCLidar-v0")):
        print_speeds(world())
        print_starts(env_id)
    print_scans()


if __name__ == "__main__":
    main()
