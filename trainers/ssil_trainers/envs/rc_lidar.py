"""The RC car as gymnasium environments: 19 LiDAR beams and the previous steering in, steering out.

The single environment is a fleet of one car, so both forms are one implementation.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Space
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.rc_car import ACTION_NAMES, BEAM_DEGREES, STATE_NAMES, Fleet, RCCar
from ssil_trainers.envs.rc_picture import picture
from ssil_trainers.envs.track import Track
from ssil_trainers.envs.tracks import TRAINING_TRACK, named_track

__all__ = ["ACTION_NAMES", "STATE_NAMES", "RCLidarEnv", "RCLidarVectorEnv"]

_STATE_LOW = np.array([0.0] * len(BEAM_DEGREES) + [-1.0], dtype=np.float32)
_METADATA = {"render_modes": ["rgb_array"], "render_fps": 10}


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

    metadata = _METADATA

    def __init__(
        self,
        track: Track | str = TRAINING_TRACK,
        *,
        car: RCCar = RCCar(),  # noqa: B008
        episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Build the track: one of `tracks.NAMED`, `seed-N`, a CSV file, or a `Track`."""
        self.render_mode = render_mode
        self.observation_space, self.action_space = _spaces()
        self._fleet, self.episode_steps = _fleet(car, track, episode_steps, 1)
        self._keyed = False

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
        """Start at a random place; `options` is not used."""
        super().reset(seed=seed)
        if seed is None and not self._keyed:
            seed = int(self.np_random.integers(2**63))
        self._keyed = True
        self._fleet.seed([seed])
        self._fleet.begin(_ONE)
        return self._fleet.states[0], {"position": self._fleet.positions[0]}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Drive for one period."""
        fleet = self._fleet
        fleet.advance(_ONE, _steering(action, 1))
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

    metadata: dict[str, Any] = _METADATA | {"autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int = 1,
        track: Track | str = TRAINING_TRACK,
        *,
        car: RCCar = RCCar(),  # noqa: B008
        episode_steps: int | None = None,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        """Build the track and the cars, as for the single environment."""
        if num_envs < 1:
            raise InvalidInputError(f"num_envs: expected at least 1, found {num_envs}")
        self.num_envs, self.render_mode = num_envs, render_mode
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = _METADATA | {"autoreset_mode": self._mode}
        self.single_observation_space, self.single_action_space = _spaces()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._fleet, self.episode_steps = _fleet(car, track, episode_steps, num_envs)
        self._all = np.ones(num_envs, dtype=np.bool_)
        self._ended = np.zeros(num_envs, dtype=np.bool_)
        self._keyed = np.zeros(num_envs, dtype=np.bool_)

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
        """Start all cars, or those of options["reset_mask"] (n,)."""
        first = seed if isinstance(seed, int) else None
        super().reset(seed=first)
        which = self._mask(options)
        seeds = _seeds(seed, self.num_envs)
        for row in np.flatnonzero(which & ~self._keyed):
            if seeds[row] is None:
                seeds[row] = int(self.np_random.integers(2**63))
        self._keyed |= which
        self._ended &= ~which
        self._fleet.seed([one if asked else None for one, asked in zip(seeds, which, strict=True)])
        self._fleet.begin(which)
        return self._fleet.states, _infos(which, position=self._fleet.positions)

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[
        NDArray[np.float32],
        NDArray[np.float64],
        NDArray[np.bool_],
        NDArray[np.bool_],
        dict[str, Any],
    ]:
        """Drive all cars for one period, or begin their next episode as autoreset_mode says."""
        fleet, begin = self._fleet, self._ended
        if self._mode is AutoresetMode.DISABLED and begin.any():
            raise InvalidInputError(
                f"step: expected a reset of car {np.argmax(begin)}, whose episode has ended"
            )
        drives = ~begin
        fleet.advance(drives, _steering(actions, self.num_envs))
        terminated = fleet.hits.copy()
        truncated = drives & ~terminated & (fleet.rows.steps >= self.episode_steps)
        rewards = (drives & ~terminated).astype(np.float64)
        if begin.any():
            fleet.begin(begin)
        self._ended = terminated | truncated
        infos: dict[str, Any] = {}
        if self._mode is AutoresetMode.SAME_STEP:
            infos = self._same_step(rewards)
        infos |= _infos(self._all, position=fleet.positions)
        if self._mode is not AutoresetMode.SAME_STEP:
            infos |= _infos(drives, underlying_reward=rewards.copy())
        return fleet.states, rewards, terminated, truncated, infos

    def _same_step(self, rewards: NDArray[np.float64]) -> dict[str, Any]:
        """Begin the next episode of those who ended; return how the last step went."""
        ended, fleet = self._ended, self._fleet
        self._ended = np.zeros_like(ended)
        infos = _infos(~ended, underlying_reward=rewards.copy()) if not ended.all() else {}
        if ended.any():
            last = np.full(self.num_envs, None, dtype=object)
            states, positions = fleet.states, fleet.positions
            for row in np.flatnonzero(ended):
                last[row] = states[row]
            final = _infos(ended, position=positions, underlying_reward=rewards.copy())
            infos |= {"final_obs": last, "_final_obs": ended.copy()}
            infos |= {"final_info": final, "_final_info": ended.copy()}
            fleet.begin(ended)
        return infos

    def _mask(self, options: dict[str, Any] | None) -> NDArray[np.bool_]:
        if not options or "reset_mask" not in options:
            return self._all
        mask = np.asarray(options["reset_mask"])
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise InvalidInputError(
                f"reset_mask: expected {self.num_envs} booleans, one of them true, found {mask}"
            )
        return mask

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


def _fleet(car: RCCar, track: Track | str, steps: int | None, cars: int) -> tuple[Fleet, int]:
    if steps is not None and steps < 1:
        raise InvalidInputError(f"episode_steps: expected at least 1, found {steps}")
    track = named_track(track) if isinstance(track, str) else track
    return Fleet(car, track, cars), steps or car.lap_steps(track)


def _steering(actions: NDArray[np.float32], cars: int) -> NDArray[np.float64]:
    """Return finite steering (n,), refusing NaN: the car would be nowhere."""
    given = np.asarray(actions, dtype=np.float64).reshape(-1)
    if given.shape != (cars,) or not np.isfinite(given).all():
        raise InvalidInputError(f"action: expected {cars} finite numbers, found {actions}")
    return given


def _seeds(seed: int | list[int | None] | None, cars: int) -> list[int | None]:
    if seed is None:
        return [None] * cars
    if isinstance(seed, int):
        return [seed + row for row in range(cars)]
    if len(seed) != cars:
        raise InvalidInputError(f"seed: expected one for each of {cars} cars, found {len(seed)}")
    return list(seed)


def _infos(which: NDArray[np.bool_], **values: NDArray[np.float64]) -> dict[str, Any]:
    """Return gymnasium's infos: every value beside the mask of the cars that it holds for."""
    infos: dict[str, Any] = {}
    for name, of_cars in values.items():
        infos[name] = np.where(which.reshape(-1, *[1] * (of_cars.ndim - 1)), of_cars, 0.0)
        infos[f"_{name}"] = which.copy()
    return infos
