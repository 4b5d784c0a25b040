"""The racetrack's twin: any number of cars in one compiled call, each as if it were alone.

Built from highway-env's own road object. Car i, reset with seed s, drives exactly as `RacetrackEnv`
reset with seed s + i. It is for training; scores are measured on the real environment.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.counts import count
from ssil_trainers.envs.racetrack import kernels
from ssil_trainers.envs.racetrack.highway import POLICY_HZ, Track, motion, simulator
from ssil_trainers.envs.racetrack.kernels import Cars
from ssil_trainers.envs.racetrack.road import Road
from ssil_trainers.envs.racetrack.starts import Start, check_starts
from ssil_trainers.envs.racetrack.state import (
    ACTION_NAMES,
    SIGHT,
    STATE_HIGH,
    STATE_LOW,
    STATE_NAMES,
    Car,
)
from ssil_trainers.envs.vector import (
    Info,
    Stepped,
    check_options,
    final_info,
    finite_actions,
    info_of,
    refuse_before_reset,
    reset_mask,
    seeds_of_cars,
)


class RacetrackVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """`RacetrackEnv`, n times, on one core; states, rewards and ends as gymnasium's SyncVectorEnv.

    info: position (n, 2) in metres, and after a step underlying_reward (n,), each with its mask.
    A car starts anew from its own generator, so what it does never depends on its neighbours.
    """

    def __init__(
        self,
        num_envs: int = 1,
        track: Track = "default",
        *,
        policy_hz: int = POLICY_HZ,
        other_vehicles: int = 0,
        episode_steps: int = 1_000,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        """Build the track; the arguments are those of `RacetrackEnv`.

        Raises InvalidInputError for other vehicles and pictures: only `RacetrackEnv` has them.
        """
        _refuse(num_envs, other_vehicles, render_mode)
        self.num_envs = num_envs
        self.metadata = {
            "render_modes": [],
            "render_fps": policy_hz,
            "autoreset_mode": AutoresetMode(autoreset_mode),
        }
        self.single_observation_space = Box(STATE_LOW, STATE_HIGH, dtype=np.float32)
        self.single_action_space = Box(-1.0, 1.0, (len(ACTION_NAMES),), dtype=np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        real = simulator(track, policy_hz=policy_hz, other_vehicles=0, render_mode=None)
        self._road = Road.of(real.road.network)
        real.close()
        self._motion = motion(policy_hz)
        self._episode_steps = count("episode_steps", episode_steps)
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._seeds = [-1] * num_envs
        self._starts = [Start(0, 0.0, 0.0)] * num_envs
        self._cars = Cars.allocate(num_envs)
        self._states = np.zeros((num_envs, len(STATE_NAMES)))
        self._rewards = np.zeros(num_envs)
        self._off_road = np.zeros(num_envs, dtype=np.bool_)
        self._ended = np.zeros(num_envs, dtype=np.bool_)
        self._steps = np.full(num_envs, -1, dtype=np.int64)  # -1: never reset

    @property
    def road(self) -> Road:
        """The road's geometry."""
        return self._road

    @property
    def starts(self) -> list[Start]:
        """Where the cars' episodes started; a reset with `options={"start": starts}` repeats."""
        return list(self._starts)

    def car(self, number: int) -> Car:
        """Return a car as it stands."""
        x, y, heading, speed = self._cars.pose[number].tolist()
        local, action = self._cars.local[number].tolist(), self._cars.action[number].tolist()
        return Car(x, y, heading, speed, int(self._cars.lane[number]), *local, *action)

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The cars' own generators."""
        return tuple(self._generator(car) for car in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The seeds of the cars' generators."""
        return tuple(self._seeds[car] for car in range(self.num_envs) if self._generator(car))

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], Info]:
        """Start all cars anew, car i with seed + i or the i-th of the seeds.

        `options` may have "start", a `Start` for each car, and "reset_mask" (n,) bool, which cars
        to start. Raises InvalidInputError, and then nothing has changed.
        """
        check_options(options, ("start", "reset_mask"))
        seeds, mask = seeds_of_cars(seed, self.num_envs), reset_mask(options, self.num_envs)
        which, told = np.flatnonzero(mask), (options or {}).get("start")
        starts = None if told is None else check_starts(told, self._road, mask)
        for car in which:
            if seeds[car] is not None:
                self._generators[car], self._seeds[car] = seeding.np_random(seeds[car])
        self._place(which, self._draw_starts(which) if starts is None else starts)
        return self._states.astype(np.float32), info_of(mask, position=self._cars.pose[:, :2])

    def step(self, actions: NDArray[np.float32]) -> Stepped:
        """Drive every car for one decision, or start it anew as the autoreset mode says.

        actions (n, 2), clipped to [-1, 1]; raises InvalidInputError where one is not finite, and
        gymnasium's ResetNeeded where a car waits for a reset.
        """
        chosen = np.clip(finite_actions(actions, self.action_space.shape), -1.0, 1.0)
        mode, restarted = self.metadata["autoreset_mode"], self._ended
        if mode == AutoresetMode.DISABLED:
            refuse_before_reset(self._ended, "")
        refuse_before_reset(self._steps < 0)
        moving = ~restarted
        moved = np.flatnonzero(moving)
        self._cars.act(chosen, self._motion)
        kernels.drive(self._cars, moved, self._motion)
        self._see(moved)
        rewards = self._rewards * moving
        terminated = self._off_road & moving
        self._steps += moving
        truncated = (self._steps >= self._episode_steps) & moving
        self._restart(restarted)
        self._ended = terminated | truncated
        info: Info = {}
        if mode == AutoresetMode.SAME_STEP and self._ended.any():
            info, moving = self._final(rewards), moving & ~self._ended
            self._restart(self._ended)
            self._ended = np.zeros(self.num_envs, dtype=np.bool_)
        everywhere = np.ones(self.num_envs, dtype=np.bool_)
        info |= info_of(everywhere, position=self._cars.pose[:, :2])
        info |= info_of(moving, underlying_reward=rewards)
        return self._states.astype(np.float32), rewards, terminated, truncated, info

    def _restart(self, which: NDArray[np.bool_]) -> None:
        """Begin the next episode of some cars (n,)."""
        rows = np.flatnonzero(which)
        self._place(rows, self._draw_starts(rows))

    def _see(self, which: NDArray[np.int64]) -> None:
        """Write states, rewards and ends of some cars."""
        (lanes, edges), pose = (self._road.lanes, self._road.edges), self._cars.pose[which]
        angles = np.arctan2(pose[:, 1:2] - lanes.y, pose[:, 0:1] - lanes.x)
        seen = self._states, self._rewards, self._off_road
        kernels.see(self._cars, which, angles, lanes, edges, SIGHT, self._motion, *seen)

    def _draw_starts(self, which: NDArray[np.int64]) -> list[Start]:
        """Draw starts of some cars from their own generators."""
        return [Start.draw(self._road, self._generator(car)) for car in which]

    def _place(self, which: NDArray[np.int64], starts: Sequence[Start]) -> None:
        """Put some cars at their starts."""
        if not len(which):
            return
        places = [(start.lane, start.longitudinal, start.speed) for start in starts]
        kernels.place(self._cars, which, np.array(places, dtype=np.float64), self._road.lanes)
        self._see(which)
        for car, start in zip(which, starts, strict=True):
            self._starts[car] = start
        self._steps[which], self._ended[which] = 0, False

    def _generator(self, car: int) -> np.random.Generator:
        generator = self._generators[car]
        if generator is None:
            generator, self._seeds[car] = seeding.np_random()
            self._generators[car] = generator
        return generator

    def _final(self, rewards: NDArray[np.float64]) -> Info:
        """Return how the episodes ended where others begin in the same step."""
        last = info_of(self._ended, position=self._cars.pose[:, :2], underlying_reward=rewards)
        return final_info(self._ended, self._states.astype(np.float32), last)


def _refuse(num_envs: int, other_vehicles: int, render_mode: str | None) -> None:
    count("num_envs", num_envs)
    if other_vehicles:
        raise InvalidInputError(
            f"other_vehicles: expected 0 in the vector environment, found {other_vehicles}; "
            "highway-env's traffic drives in the single one, gymnasium.make('SSILRacetrack-v0')"
        )
    if render_mode is not None:
        raise InvalidInputError(
            f"render_mode: expected None in the vector environment, found {render_mode!r}; "
            "the single one, gymnasium.make('SSILRacetrack-v0'), makes pictures"
        )
