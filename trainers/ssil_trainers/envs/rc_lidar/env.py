"""The RC car as a gymnasium environment: 19 LiDAR beams and the previous steering in, steering out.

It is a fleet of one car, so the single and the vector environment are one implementation.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.counts import check_count
from ssil_trainers.envs.rc_lidar.car import ACTION_NAMES, BEAM_DEGREES, STATE_NAMES, Fleet, RCCar
from ssil_trainers.envs.rc_lidar.rendering import render_car
from ssil_trainers.envs.rc_lidar.track import Track
from ssil_trainers.envs.rc_lidar.tracks import TRAINING_TRACK, find_track
from ssil_trainers.envs.vector import check_actions, check_options, check_seed, require_reset

__all__ = ["ACTION_NAMES", "STATE_NAMES", "RCLidarEnv"]

_STATE_LOW = np.array([0.0] * len(BEAM_DEGREES) + [-1.0], dtype=np.float32)


class RCLidarEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One RC car at constant speed between two walls; `gymnasium.make("RCLidar-v0")`.

    State (20): ranges of 19 beams from −90° (right) to 90° (left) as shares of the reach, and the
    previous steering. Action (1): steering in [-1, 1], left positive; what is beyond is clipped.
    An episode ends (terminated) when a side of the car's rectangle crosses a wall, and is cut off
    (truncated) after `episode_steps`. It starts anywhere on the lap, up to 10 cm off the center
    line and 5° askew, wheels straight. The reward is 1 for a step that is survived and 0 for the
    one that ends at a wall: for evaluation, and for training drivers of demonstrations; imitation
    trainers must not read it. The score of an episode is its return ÷ `episode_steps`.
    info: position (x, y) of the rear axle in meters, and after a step underlying_reward.

    Parameters
    ----------
    track:
        A name of `tracks.NAMED`, `seed-N`, a CSV file, or a `Track`.
    car:
        The car.
    episode_steps:
        Time limit of an episode; None is one lap down the center line, which is 400 steps on every
        track of the package.
    render_mode:
        None or "rgb_array".

    Raises
    ------
    NotFoundError
        For an unknown track.
    InvalidInputError
        For a file that holds no track, or a car that could start in a wall.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
    >>> env = RCLidarEnv("hall")
    >>> state, info = env.reset(seed=0)
    >>> state, reward, terminated, truncated, info = env.step(np.array([0.1], dtype=np.float32))
    >>> state.shape, reward, env.episode_steps
    ((20,), 1.0, 400)
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
        """Build the track; the car is not on it before `reset`."""
        self.render_mode = render_mode
        self.observation_space, self.action_space = make_spaces()
        self._fleet, self.episode_steps = make_fleet(car, track, episode_steps, 1)
        self.metadata = {**self.metadata, "render_fps": car.hz}

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
        return self._fleet.cars.pose[0].copy()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start at a random place.

        Parameters
        ----------
        seed:
            Draws the start and the noise; None goes on with the car's own randomness.
        options:
            None: there are no options.

        Returns
        -------
        state, info
            What the car sees (20,), and its position (2,) [m].

        Raises
        ------
        InvalidInputError
            For an option, or something that is no seed.
        """
        check_options(options, ())
        seed = check_seed(seed)
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

        Parameters
        ----------
        action:
            Steering (1,), left positive, clipped to [-1, 1].

        Returns
        -------
        state, reward, terminated, truncated, info
            What the car sees (20,), 1 if it survived the step, whether it hit a wall, whether the
            time limit is reached, and position and underlying reward.

        Raises
        ------
        InvalidInputError
            For steering that is not finite.
        gymnasium.error.ResetNeeded
            Before the first reset.
        """
        fleet = self._fleet
        steering = check_actions(action, self.action_space.shape)
        require_reset(~fleet.is_placed)
        fleet.drive(_ONE, steering)
        hit = bool(fleet.hits[0])
        reward = 0.0 if hit else 1.0
        info = {"position": fleet.positions[0], "underlying_reward": reward}
        over = not hit and bool(fleet.cars.steps[0] >= self.episode_steps)
        return fleet.states[0], reward, hit, over, info

    def render(self) -> Any:
        """Return the picture (480, 720, 3) uint8, or None without a render mode."""
        return render_car(self._fleet, 0) if self.render_mode else None


_ONE = np.ones(1, dtype=np.bool_)


def make_spaces() -> tuple[Space[Any], Space[Any]]:
    """Return the observation space and the action space of one car.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.env import make_spaces
    >>> [space.shape for space in make_spaces()]
    [(20,), (1,)]
    """
    high = np.ones(len(STATE_NAMES), dtype=np.float32)
    return (
        Box(_STATE_LOW, high, dtype=np.float32),
        Box(-1.0, 1.0, (len(ACTION_NAMES),), dtype=np.float32),
    )


def make_fleet(
    car: RCCar, track: Track | Path | str, episode_steps: int | None, cars: int
) -> tuple[Fleet, int]:
    """Return cars on a track, and the time limit of their episodes.

    Parameters
    ----------
    car, track, episode_steps:
        As for `RCLidarEnv`.
    cars:
        Number of cars.

    Raises
    ------
    NotFoundError, InvalidInputError
        As `RCLidarEnv`.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.car import RCCar
    >>> from ssil_trainers.envs.rc_lidar.env import make_fleet
    >>> fleet, episode_steps = make_fleet(RCCar(), "hall", None, 3)
    >>> len(fleet), episode_steps
    (3, 400)
    """
    if not isinstance(car, RCCar):
        raise InvalidInputError(f"car: expected an RCCar, found {car!r}")
    if episode_steps is not None:
        check_count("episode_steps", episode_steps)
    if isinstance(track, str | Path):
        track = find_track(str(track))
    if not isinstance(track, Track):
        raise InvalidInputError(f"track: expected a name, a CSV file or a Track, found {track!r}")
    return Fleet(car, track, cars), episode_steps or car.lap_steps(track)
