"""The expert of the RC car: it knows where it is, and steers down the middle of the road."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ssil_trainers.envs.rc_lidar.env import RCLidarEnv


class Pursuit:
    """Pure pursuit (Coulter 1992): steer along the arc to a point of the centre line ahead.

    It reads the car's pose from the environment, not the state: a good driver knows the track.
    """

    def __init__(self, env: RCLidarEnv, *, ahead: float) -> None:
        """Aim `ahead` metres down the centre line of that environment's track."""
        self._env, self._ahead = env, ahead
        self._line = env.track.places(_SPACING)[:, :2]

    def __call__(self, state: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the steering (1,) for where the car is now."""
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


_SPACING = 0.05
