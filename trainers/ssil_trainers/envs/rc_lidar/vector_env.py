"""Many RC cars side by side, as one gymnasium vector environment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ssil_trainers.envs.counts import check_count
from ssil_trainers.envs.rc_lidar.car import RCCar
from ssil_trainers.envs.rc_lidar.env import make_fleet, make_spaces
from ssil_trainers.envs.rc_lidar.rendering import render_car
from ssil_trainers.envs.rc_lidar.track import Track
from ssil_trainers.envs.rc_lidar.tracks import TRAINING_TRACK
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


class RCLidarVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """`RCLidarEnv`, n times, side by side; `gymnasium.make_vec("RCLidar-v0", num_envs=64)`.

    The cars do not meet. Car i after reset(seed=s) drives as the single environment after
    reset(seed=s + i), whatever the number of cars, also in the episodes that follow.

    Parameters
    ----------
    num_envs:
        Number of cars n.
    track, car, episode_steps, render_mode:
        As for `RCLidarEnv`.
    autoreset_mode:
        gymnasium's: when an ended episode is followed by the next one.

    Raises
    ------
    NotFoundError, InvalidInputError
        As `RCLidarEnv`.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.vector_env import RCLidarVectorEnv
    >>> cars = RCLidarVectorEnv(3, "hall")
    >>> states, info = cars.reset(seed=0)
    >>> states.shape, info["position"].shape
    ((3, 20), (3, 2))
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        track: Track | Path | str = TRAINING_TRACK,
        *,
        car: RCCar = RCCar(),  # noqa: B008
        episode_steps: int | None = None,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        """Build the track and the cars; no car is on it before `reset`."""
        self.num_envs = check_count("num_envs", num_envs)
        self.render_mode = render_mode
        self._mode = AutoresetMode(autoreset_mode)
        self.single_observation_space, self.single_action_space = make_spaces()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._fleet, self.episode_steps = make_fleet(car, track, episode_steps, num_envs)
        self.metadata = {
            **self.metadata,
            "render_fps": car.hz,
            "autoreset_mode": self._mode,
        }
        self._all = np.ones(num_envs, dtype=np.bool_)
        self._ended = np.zeros(num_envs, dtype=np.bool_)

    @property
    def track(self) -> Track:
        """The track."""
        return self._fleet.track

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start all cars anew, or some of them.

        Parameters
        ----------
        seed:
            Car i gets seed + i, or the i-th of a sequence; None keeps the cars' own randomness.
        options:
            May have "reset_mask", booleans (n,): which cars to start.

        Returns
        -------
        states, info
            What the cars see (n, 20), and their positions (n, 2) [m].

        Raises
        ------
        InvalidInputError
            For seeds or options that it cannot take; then nothing has changed.
        """
        check_options(options, ("reset_mask",))
        seeds = assign_seeds(seed, self.num_envs)
        which = read_reset_mask(options, self.num_envs)
        super().reset(seed=seeds[0] if isinstance(seed, int | np.integer) else None)
        for row in np.flatnonzero(which & ~self._fleet.is_placed):
            if seeds[row] is None:
                seeds[row] = int(self.np_random.integers(2**63))
        self._ended &= ~which
        self._fleet.seed([one if start else None for one, start in zip(seeds, which, strict=True)])
        self._fleet.begin(which)
        return self._fleet.states, build_info(which, position=self._fleet.positions)

    def step(self, actions: NDArray[np.float32]) -> StepResult:
        """Drive all cars for one period, or begin their next episode as autoreset_mode says.

        Parameters
        ----------
        actions:
            Steering (n, 1), left positive, clipped to [-1, 1].

        Returns
        -------
        states, rewards, terminated, truncated, info
            What the cars see (n, 20), 1 where a step was survived (n,), whether they hit a wall
            (n,), whether the time limit is reached (n,), and positions and underlying rewards.

        Raises
        ------
        InvalidInputError
            For steering that is not finite.
        gymnasium.error.ResetNeeded
            Where a car has to be reset first.
        """
        fleet = self._fleet
        begin = self._ended
        steering = check_actions(actions, self.action_space.shape)
        if self._mode is AutoresetMode.DISABLED:
            require_reset(begin, "")
        require_reset(~fleet.is_placed)
        drives = ~begin
        fleet.drive(drives, steering[:, 0])
        terminated = fleet.hits
        truncated = drives & ~terminated & (fleet.cars.steps >= self.episode_steps)
        rewards = (drives & ~terminated).astype(np.float64)
        fleet.begin(begin)
        self._ended = terminated | truncated
        info: Info = {}
        if self._mode is AutoresetMode.SAME_STEP and self._ended.any():
            info = self._final_info(rewards)
            drives = drives & ~self._ended
            fleet.begin(self._ended)
            self._ended = np.zeros(self.num_envs, dtype=np.bool_)
        info |= build_info(self._all, position=fleet.positions)
        info |= build_info(drives, underlying_reward=rewards)
        return fleet.states, rewards, terminated, truncated, info

    def _final_info(self, rewards: NDArray[np.float64]) -> Info:
        """Return how the episodes ended where others begin in the same step."""
        positions = self._fleet.positions
        last = build_info(self._ended, position=positions, underlying_reward=rewards)
        return build_final_info(self._ended, self._fleet.states, last)

    def render(self) -> Any:
        """Return every car's picture, or None without a render mode."""
        if not self.render_mode:
            return None
        return tuple(render_car(self._fleet, row) for row in range(self.num_envs))
