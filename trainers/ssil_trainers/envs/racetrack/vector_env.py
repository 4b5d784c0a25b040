"""The racetrack's vectorized twin: any number of cars in one compiled call, each as if alone.

It is built from highway-env's own road object. Car i, reset with seed s, drives exactly as
`RacetrackEnv` reset with seed s + i. It is for training; scores are measured on the real one.
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
from ssil_trainers.envs.counts import check_count
from ssil_trainers.envs.racetrack import kernels
from ssil_trainers.envs.racetrack.highway import (
    POLICY_HZ,
    TrackName,
    make_simulator,
    motion_constants,
)
from ssil_trainers.envs.racetrack.kernels import Cars, Output
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
    StepResult,
    assign_seeds,
    build_final_info,
    build_info,
    check_actions,
    check_options,
    read_reset_mask,
    require_reset,
)


class RacetrackVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """`RacetrackEnv`, n times, on one core: states, rewards and ends as gymnasium's SyncVectorEnv.

    info: position (n, 2) in meters, and after a step underlying_reward (n,), each with its mask.
    A car starts anew from its own generator, so what it does never depends on its neighbors.

    Parameters
    ----------
    num_envs:
        Number of cars n.
    track, policy_hz, episode_steps:
        As for `RacetrackEnv`.
    other_vehicles:
        0; only `RacetrackEnv` has highway-env's traffic.
    autoreset_mode:
        gymnasium's: when an ended episode is followed by the next one.
    render_mode:
        None; only `RacetrackEnv` makes pictures.

    Raises
    ------
    InvalidInputError
        For other vehicles, a render mode, or settings that `RacetrackEnv` refuses.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.vector_env import RacetrackVectorEnv
    >>> cars = RacetrackVectorEnv(3, track="oval")
    >>> states, info = cars.reset(seed=0)
    >>> states.shape, info["position"].shape
    ((3, 29), (3, 2))
    """

    def __init__(
        self,
        num_envs: int = 1,
        track: TrackName = "default",
        *,
        policy_hz: int = POLICY_HZ,
        other_vehicles: int = 0,
        episode_steps: int = 1_000,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        """Build the track and the cars; no car is on it before `reset`."""
        _refuse_unsupported(num_envs, other_vehicles, render_mode)
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
        original = make_simulator(track, policy_hz=policy_hz, other_vehicles=0, render_mode=None)
        self._road = Road.from_network(original.road.network)
        original.close()
        self._track = kernels.Track(
            self._road.lanes, self._road.edges, SIGHT, motion_constants(policy_hz)
        )
        self._episode_steps = check_count("episode_steps", episode_steps)
        self._generators: list[np.random.Generator | None] = [None] * num_envs
        self._seeds = [-1] * num_envs
        self._starts = [Start(0, 0.0, 0.0)] * num_envs
        self._cars = Cars.allocate(num_envs)
        self._output = Output.allocate(num_envs, len(STATE_NAMES))
        self._ended = np.zeros(num_envs, dtype=np.bool_)
        self._steps = np.full(num_envs, -1, dtype=np.int64)  # -1: never reset

    @property
    def road(self) -> Road:
        """The road's geometry."""
        return self._road

    @property
    def starts(self) -> list[Start]:
        """Where the cars' episodes started; `options={"start": starts}` repeats them."""
        return list(self._starts)

    def car(self, number: int) -> Car:
        """Return one car as it stands.

        Parameters
        ----------
        number:
            Its row, from 0.
        """
        cars = self._cars
        x, y, heading, speed = cars.pose[number].tolist()
        longitudinal, lateral, heading_error = cars.local[number].tolist()
        throttle, steering = cars.action[number].tolist()
        return Car(
            x=x,
            y=y,
            heading=heading,
            speed=speed,
            lane=int(cars.lane[number]),
            longitudinal=longitudinal,
            lateral=lateral,
            heading_error=heading_error,
            throttle=throttle,
            steering=steering,
        )

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
        """Start all cars anew, or some of them.

        Parameters
        ----------
        seed:
            Car i gets seed + i, or the i-th of a sequence; None keeps the cars' own generators.
        options:
            May have "start", a `Start` for each car, and "reset_mask", booleans (n,): which cars
            to start.

        Returns
        -------
        states, info
            What the cars see (n, 29), and their positions (n, 2) [m].

        Raises
        ------
        InvalidInputError
            For seeds, options or starts that it cannot take; then nothing has changed.
        """
        check_options(options, ("start", "reset_mask"))
        seeds = assign_seeds(seed, self.num_envs)
        mask = read_reset_mask(options, self.num_envs)
        which = np.flatnonzero(mask)
        requested = (options or {}).get("start")
        starts = None if requested is None else check_starts(requested, self._road, mask)
        for car in which:
            if seeds[car] is not None:
                self._generators[car], self._seeds[car] = seeding.np_random(seeds[car])
        self._place(which, self._draw_starts(which) if starts is None else starts)
        return self._states(), build_info(mask, position=self._cars.pose[:, :2])

    def step(self, actions: NDArray[np.float32]) -> StepResult:
        """Drive every car for one decision, or start it anew as the autoreset mode says.

        Parameters
        ----------
        actions:
            Throttle and steering (n, 2), clipped to [-1, 1].

        Returns
        -------
        states, rewards, terminated, truncated, info
            What the cars see (n, 29), rewards (n,), whether they left the road (n,), whether the
            time limit is reached (n,), and positions and underlying rewards.

        Raises
        ------
        InvalidInputError
            For an action that is not finite.
        gymnasium.error.ResetNeeded
            Where a car has to be reset first.
        """
        chosen = np.clip(check_actions(actions, self.action_space.shape), -1.0, 1.0)
        mode = self.metadata["autoreset_mode"]
        restarted = self._ended
        if mode == AutoresetMode.DISABLED:
            require_reset(self._ended, "")
        require_reset(self._steps < 0)
        moving = ~restarted
        moved = np.flatnonzero(moving)
        self._cars.act(chosen, self._track.motion)
        kernels.drive_cars(self._cars, moved, self._track.motion)
        self._observe(moved)
        rewards = self._output.rewards * moving
        terminated = self._output.off_road & moving
        self._steps += moving
        truncated = (self._steps >= self._episode_steps) & moving
        self._restart(restarted)
        self._ended = terminated | truncated
        info: Info = {}
        if mode == AutoresetMode.SAME_STEP and self._ended.any():
            info = self._final_info(rewards)
            moving = moving & ~self._ended
            self._restart(self._ended)
            self._ended = np.zeros(self.num_envs, dtype=np.bool_)
        everywhere = np.ones(self.num_envs, dtype=np.bool_)
        info |= build_info(everywhere, position=self._cars.pose[:, :2])
        info |= build_info(moving, underlying_reward=rewards)
        return self._states(), rewards, terminated, truncated, info

    def _states(self) -> NDArray[np.float32]:
        """Return what all cars see (n, 29)."""
        return self._output.states.astype(np.float32)

    def _restart(self, which: NDArray[np.bool_]) -> None:
        """Begin the next episode of some cars (n,)."""
        rows = np.flatnonzero(which)
        self._place(rows, self._draw_starts(rows))

    def _observe(self, which: NDArray[np.int64]) -> None:
        """Write states, rewards and ends of some cars."""
        lanes = self._road.lanes
        pose = self._cars.pose[which]
        # The last bits of arctan2 decide between lanes, and NumPy's are not the compiler's.
        angles = np.arctan2(pose[:, 1:2] - lanes.y, pose[:, 0:1] - lanes.x)
        kernels.observe_cars(self._cars, which, angles, self._track, self._output)

    def _draw_starts(self, which: NDArray[np.int64]) -> list[Start]:
        """Draw starts of some cars from their own generators."""
        return [Start.draw(self._road, self._generator(car)) for car in which]

    def _place(self, which: NDArray[np.int64], starts: Sequence[Start]) -> None:
        """Put some cars at their starts."""
        if not len(which):
            return
        places = [(start.lane, start.longitudinal, start.speed) for start in starts]
        kernels.place_cars(self._cars, which, np.array(places, dtype=np.float64), self._road.lanes)
        self._observe(which)
        for car, start in zip(which, starts, strict=True):
            self._starts[car] = start
        self._steps[which] = 0
        self._ended[which] = False

    def _generator(self, car: int) -> np.random.Generator:
        """Return a car's own generator, from the system's entropy if it was never given a seed."""
        generator = self._generators[car]
        if generator is None:
            generator, self._seeds[car] = seeding.np_random()
            self._generators[car] = generator
        return generator

    def _final_info(self, rewards: NDArray[np.float64]) -> Info:
        """Return how the episodes ended where others begin in the same step."""
        last = build_info(self._ended, position=self._cars.pose[:, :2], underlying_reward=rewards)
        return build_final_info(self._ended, self._states(), last)


def _refuse_unsupported(num_envs: int, other_vehicles: int, render_mode: str | None) -> None:
    """Raise InvalidInputError for what only the single environment has."""
    check_count("num_envs", num_envs)
    if other_vehicles:
        raise InvalidInputError(
            f"other_vehicles: expected 0 in the vector environment, found {other_vehicles}; "
            "use the single environment for traffic, gymnasium.make('SSILRacetrack-v0')"
        )
    if render_mode is not None:
        raise InvalidInputError(
            f"render_mode: expected None in the vector environment, found {render_mode!r}; "
            "use the single environment for pictures, gymnasium.make('SSILRacetrack-v0')"
        )
