"""The expert of the RC car: it knows where it is, and steers down the middle of the road."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ssil_trainers.envs.rc_lidar.env import RCLidarEnv

_SPACING = 0.05
"""Distance of the points of the center line that are aimed at [m]."""


class PurePursuit:
    """Pure pursuit: steer along the arc to a point of the center line ahead.

    It reads the car's pose from the environment, not from the state: it knows the track.

    Parameters
    ----------
    env:
        The environment that it drives in.
    ahead:
        How far down the center line it aims [m].

    Source
    ------
    Coulter: Implementation of the pure pursuit path tracking algorithm, 1992.

    Examples
    --------
    >>> from ssil_trainers.collection.pure_pursuit import PurePursuit
    >>> from ssil_trainers.collection.recording import record
    >>> from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
    >>> env = RCLidarEnv("hall", episode_steps=50)
    >>> record(env, PurePursuit(env, ahead=1.4), seed=0).total_reward
    50.0
    """

    def __init__(self, env: RCLidarEnv, *, ahead: float) -> None:
        """Sample the center line."""
        self._env = env
        self._ahead = ahead
        self._line = env.track.sample_poses(_SPACING)[:, :2]

    def __call__(self, state: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the steering (1,) for where the car is now; the state is not read."""
        x, y, heading = self._env.pose
        nearest = int(np.argmin(np.sum((self._line - [x, y]) ** 2, axis=1)))
        aim = self._line[(nearest + round(self._ahead / _SPACING)) % len(self._line)]
        away = aim - [x, y]
        across = away[1] * np.cos(heading) - away[0] * np.sin(heading)
        car = self._env.car
        angle = np.arctan(2 * car.wheelbase * across / np.sum(away**2))
        steering = angle / np.deg2rad(car.steering_degrees)
        return np.clip([steering], -1.0, 1.0).astype(np.float32)

    def __str__(self) -> str:
        """Name the driver."""
        return f"pure pursuit {self._ahead:g} m ahead"
