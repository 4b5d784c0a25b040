"""The RC car as gymnasium environments: 19 LiDAR beams and the previous steering in, steering out.

The single environment is a fleet of one car, so both forms are one implementation.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Space
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.counts import count
from ssil_trainers.envs.rc_lidar.car import ACTION_NAMES, BEAM_DEGREES, STATE_NAMES, Fleet, RCCar
from ssil_trainers.envs.rc_lidar.rendering import picture
from ssil_trainers.envs.rc_lidar.track import Track
from ssil_trainers.envs.rc_lidar.tracks import TRAINING_TRACK, find_track
from ssil_trainers.envs.vector import (
    Info,
    Stepped,
    check_options,
    final_info,
    finite_actions,
    info_of,
    one_seed,
    refuse_before_reset,
    reset_mask,
    seeds_of_cars,
)

__all__ = ["ACTION_NAMES", "STATE_NAMES", "RCLidarEnv", "RCLidarVectorEnv"]

_STATE_LOW = np.array([0.0] * len(BEAM_DEGREES) + [-1.0], dtype=np.float32)


class RCLidarEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One RC car at constant speed between two walls.

    State (20): ranges of 19 beams from −90° (right) to 90° (left) as shares of the reach, and the
    previous steering. Action (1): steering in [-1, 1], left positive; what is beyond is clipped.
    An episode ends (terminated) when a side of the car's rectangle crosses a wall, and is cut off
    (truncated) after `episode_steps`: without it, the steps of one lap down the centre line,
    which are 400 on every track of the package. The reward is 1 for a step that is survived and 0
    for the one that ends at a wall: for evaluation, and for training drivers of demonstrations;
    imitation trainers must not read it. The score of an episode is its return ÷ `episode_steps`.
    It starts anywhere on the lap, up to 10 cm off the centre line and 5° askew, wheels straight.
    info: position (x, y) of the rear axle in metres, and after a step underlying_reward.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        track: Track | Path | str = TRAINING_TRACK,
        *,
        car: RCCar = RCCar(),  # noqa: B008
        episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Build the track: one of `tracks.NAMED`, `seed-N`, a CSV file, or a `Track`."""
        self.render_mode = render_mode
        self.observation_space, self.action_space = _spaces()
        self._fleet, self.episode_steps = _fleet(car, track, episode_steps, 1)
        self.metadata = _metadata(car)

    @property
    def track(self) -> Track:
        """The track."""
        return self._fleet.track

    @property
    def car(self) -> RCCar:
        """The car."""
        return self._fleet.car

    @property
    def pose(self) -> NDArray[np.float64]:
        """x, y [m] of the rear axle and heading [rad]; no part of the state."""
        return self._fleet.rows.pose[0].copy()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start at a random place; raises InvalidInputError for any option: there is none."""
        check_options(options, ())
        seed = one_seed(seed)
        super().reset(seed=seed)
        if seed is None and not self._fleet.is_placed[0]:
            seed = int(self.np_random.integers(2**63))
        self._fleet.seed([seed])
        self._fleet.begin(_ONE)
        return self._fleet.states[0], {"position": self._fleet.positions[0]}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Drive for one period.

        Raises InvalidInputError for steering that is not finite, and gymnasium's ResetNeeded
        before the first reset.
        """
        fleet = self._fleet
        steering = finite_actions(action, self.action_space.shape)
        refuse_before_reset(~fleet.is_placed)
        fleet.advance(_ONE, steering)
        hit = bool(fleet.hits[0])
        reward = 0.0 if hit else 1.0
        info = {"position": fleet.positions[0], "underlying_reward": reward}
        over = not hit and bool(fleet.rows.steps[0] >= self.episode_steps)
        return fleet.states[0], reward, hit, over, info

    def render(self) -> Any:
        """Return the picture (480, 720, 3) uint8, or None without a render mode."""
        return picture(self._fleet, 0) if self.render_mode else None


class RCLidarVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[Any]]):
    """Many such cars that do not meet; `gymnasium.make_vec("RCLidar-v0", num_envs=64)`.

    Car i after reset(seed=s) drives as the single environment after reset(seed=s + i), whatever
    the number of cars, also in the episodes that follow. autoreset_mode is gymnasium's.
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
        """Build the track and the cars, as for the single environment."""
        self.num_envs, self.render_mode = count("num_envs", num_envs), render_mode
        self._mode = AutoresetMode(autoreset_mode)
        self.single_observation_space, self.single_action_space = _spaces()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._fleet, self.episode_steps = _fleet(car, track, episode_steps, num_envs)
        self.metadata = _metadata(car) | {"autoreset_mode": self._mode}
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
        """Start all cars, or those of options["reset_mask"] (n,), a bool array.

        Raises InvalidInputError, and then nothing has changed.
        """
        check_options(options, ("reset_mask",))
        seeds, which = seeds_of_cars(seed, self.num_envs), reset_mask(options, self.num_envs)
        super().reset(seed=seeds[0] if isinstance(seed, int | np.integer) else None)
        for row in np.flatnonzero(which & ~self._fleet.is_placed):
            if seeds[row] is None:
                seeds[row] = int(self.np_random.integers(2**63))
        self._ended &= ~which
        self._fleet.seed([one if asked else None for one, asked in zip(seeds, which, strict=True)])
        self._fleet.begin(which)
        return self._fleet.states, info_of(which, position=self._fleet.positions)

    def step(self, actions: NDArray[np.float32]) -> Stepped:
        """Drive all cars for one period, or begin their next episode as autoreset_mode says.

        actions (n, 1); raises InvalidInputError where one is not finite, and gymnasium's
        ResetNeeded where a car waits for a reset.
        """
        fleet, begin = self._fleet, self._ended
        steering = finite_actions(actions, self.action_space.shape)
        if self._mode is AutoresetMode.DISABLED:
            refuse_before_reset(begin, "")
        refuse_before_reset(~fleet.is_placed)
        drives = ~begin
        fleet.advance(drives, steering[:, 0])
        terminated = fleet.hits.copy()
        truncated = drives & ~terminated & (fleet.rows.steps >= self.episode_steps)
        rewards = (drives & ~terminated).astype(np.float64)
        fleet.begin(begin)
        self._ended = terminated | truncated
        info: Info = {}
        if self._mode is AutoresetMode.SAME_STEP and self._ended.any():
            info, drives = self._final(rewards), drives & ~self._ended
            fleet.begin(self._ended)
            self._ended = np.zeros(self.num_envs, dtype=np.bool_)
        info |= info_of(self._all, position=fleet.positions)
        info |= info_of(drives, underlying_reward=rewards)
        return fleet.states, rewards, terminated, truncated, info

    def _final(self, rewards: NDArray[np.float64]) -> Info:
        """Return how the episodes ended where others begin in the same step."""
        positions = self._fleet.positions
        last = info_of(self._ended, position=positions, underlying_reward=rewards)
        return final_info(self._ended, self._fleet.states, last)

    def render(self) -> Any:
        """Return every car's picture, or None without a render mode."""
        if not self.render_mode:
            return None
        return tuple(picture(self._fleet, row) for row in range(self.num_envs))


_ONE = np.ones(1, dtype=np.bool_)


def _spaces() -> tuple[Space[Any], Space[Any]]:
    high = np.ones(len(STATE_NAMES), dtype=np.float32)
    return (
        Box(_STATE_LOW, high, dtype=np.float32),
        Box(-1.0, 1.0, (len(ACTION_NAMES),), dtype=np.float32),
    )


def _metadata(car: RCCar) -> dict[str, Any]:
    return {"render_modes": ["rgb_array"], "render_fps": car.hz}


def _fleet(
    car: RCCar, track: Track | Path | str, steps: int | None, cars: int
) -> tuple[Fleet, int]:
    if not isinstance(car, RCCar):
        raise InvalidInputError(f"car: expected an RCCar, found {car!r}")
    if steps is not None:
        count("episode_steps", steps)
    if isinstance(track, str | Path):
        track = find_track(str(track))
    if not isinstance(track, Track):
        raise InvalidInputError(f"track: expected a name, a CSV file or a Track, found {track!r}")
    return Fleet(car, track, cars), steps or car.lap_steps(track)
