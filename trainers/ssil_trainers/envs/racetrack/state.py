"""What a racetrack driver sees, and the reward of a step: pure functions of road and car.

Angles grow from the car's left to its right, as positive steering does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_trainers.envs.racetrack.kernels import Sight
from ssil_trainers.envs.racetrack.road import Road

RAY_DEGREES = tuple(range(-90, 91, 10))
RAY_REACH = 60.0
OFFSET_SCALE = 5.0
SPEED_SCALE = 20.0
CURVATURE_SCALE = 20.0
CURVATURE_AHEAD = (5.0, 12.0, 22.0)
STEERING_LIMIT = np.pi / 4
CAR_LENGTH = 5.0

ACTION_NAMES = ("throttle", "steering")
STATE_NAMES = (
    *(f"ray {degrees}°" for degrees in RAY_DEGREES),
    "heading error",
    "lateral offset",
    "forward speed",
    "lateral speed",
    "yaw rate",
    "previous throttle",
    "previous steering",
    *(f"curvature +{distance:.0f} m" for distance in CURVATURE_AHEAD),
)
STATE_HIGH = np.array([1.0] * 19 + [np.pi, 3, 1.1, 0.5, 4, 1, 1] + [2.5] * 3, dtype=np.float32)
STATE_LOW = np.array([0.0] * 19 + [-np.pi, -3, -0.1, -0.5, -4, -1, -1] + [-2.5] * 3, np.float32)

SIGHT = Sight(
    rays=np.deg2rad(RAY_DEGREES),
    reach=RAY_REACH,
    ahead=np.array(CURVATURE_AHEAD),
    offset_scale=OFFSET_SCALE,
    speed_scale=SPEED_SCALE,
    curvature_scale=CURVATURE_SCALE,
)


@dataclass(frozen=True)
class Car:
    """What the simulator knows of the car.

    Parameters
    ----------
    x, y:
        Middle of the car [m].
    heading:
        Direction of its axis [rad].
    speed:
        Along its velocity [m/s].
    lane:
        Row of the lane in `Road.lanes`.
    longitudinal, lateral:
        Along and off that lane, right positive [m].
    heading_error:
        The car's heading less the lane's, in [-π, π) [rad].
    throttle, steering:
        Previous action in [-1, 1].

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.state import Car
    >>> Car(0, 0, 0, 10, lane=0, longitudinal=0, lateral=0, heading_error=0).slip
    0.0
    """

    x: float
    y: float
    heading: float
    speed: float
    lane: int
    longitudinal: float
    lateral: float
    heading_error: float
    throttle: float = 0.0
    steering: float = 0.0

    @property
    def slip(self) -> float:
        """Angle between the car's axis and its velocity [rad], of the kinematic bicycle."""
        return float(np.arctan(0.5 * np.tan(self.steering * STEERING_LIMIT)))


def offset(road: Road, car: Car) -> float:
    """Return how far the car is to the right of the road's center line [m].

    Parameters
    ----------
    road:
        The road.
    car:
        The car on it.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.env import RacetrackEnv
    >>> from ssil_trainers.envs.racetrack.state import Car, offset
    >>> road = RacetrackEnv().road
    >>> car = Car(70, 0, 0, 10, lane=0, longitudinal=28, lateral=0.5, heading_error=0)
    >>> offset(road, car)
    -2.0
    """
    return car.lateral + float(road.lanes.axis_offset[car.lane])


def observe(
    road: Road, car: Car, *, boxes: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the state: the 29 numbers of `STATE_NAMES`.

    Rays to the edge of the road in units of 60 m (19), heading error [rad], offset from the
    road's center line in 5 m (1 = the edge of a two-lane road), speeds along and across the car's
    axis in 20 m/s, yaw rate [rad/s], previous action (2), curvature 5, 12 and 22 m ahead in 1/20 m.
    The vector environment has its own compiled form of this; the tests compare the two.

    Parameters
    ----------
    road:
        The road.
    car:
        The car on it.
    boxes:
        Sides of other vehicles (b, 4), which stop rays as the edge does.

    Returns
    -------
    ndarray of float64
        The state (29,).

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.env import RacetrackEnv
    >>> from ssil_trainers.envs.racetrack.state import Car, observe
    >>> road = RacetrackEnv().road
    >>> car = Car(70, 0, 0, 10, lane=0, longitudinal=28, lateral=0.5, heading_error=0)
    >>> observe(road, car)[20].item()  # the offset in units of 5 m
    -0.4
    """
    forward = car.speed * np.cos(car.slip)
    sideways = car.speed * np.sin(car.slip)
    rays = road.ray_distances(car.x, car.y, car.heading + SIGHT.rays, RAY_REACH, boxes=boxes)
    ahead = [
        road.curvature_ahead(car.lane, car.longitudinal, distance) for distance in CURVATURE_AHEAD
    ]
    motion = [
        car.heading_error,
        offset(road, car) / OFFSET_SCALE,
        forward / SPEED_SCALE,
        sideways / SPEED_SCALE,
        sideways / (CAR_LENGTH / 2),
        car.throttle,
        car.steering,
    ]
    return np.concatenate([rays / RAY_REACH, motion, np.multiply(ahead, CURVATURE_SCALE)])


def leaves_road(road: Road, car: Car) -> bool:
    """Tell whether the middle of the car is beyond an edge of the road.

    highway-env looks at the closest lane instead, and on the default track two lanes lie 8 cm
    apart: a car that changes lanes there would sometimes count as off the road.

    Parameters
    ----------
    road:
        The road.
    car:
        The car on it.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.env import RacetrackEnv
    >>> from ssil_trainers.envs.racetrack.state import Car, leaves_road
    >>> road = RacetrackEnv().road
    >>> car = Car(70, 0, 0, 10, lane=0, longitudinal=28, lateral=-3, heading_error=0)
    >>> leaves_road(road, car)  # 5.5 m left of the center line
    True
    """
    return bool(abs(offset(road, car)) > road.lanes.half_width[car.lane])


def underlying_reward(road: Road, car: Car) -> float:
    """Return the reward of a step: more is better, and a step at full speed is worth about 20.

    R = v_x cos θ − |v_y sin θ| − 2 v_x |d sin θ| − v_y cos θ, with speeds v along and across the
    car's axis in m/s, heading error θ, and offset d from the road's center line in units of 5 m,
    which is ±1 at the edges of the two-lane track: TORCS measures its `trackPos` so, and in meters
    the third term would outweigh the first.

    Parameters
    ----------
    road:
        The road.
    car:
        The car on it, after the action.

    Source
    ------
    Lee et al., the SSIL paper, for TORCS.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.env import RacetrackEnv
    >>> from ssil_trainers.envs.racetrack.state import Car, underlying_reward
    >>> road = RacetrackEnv().road
    >>> car = Car(70, 0, 0, 10, lane=0, longitudinal=28, lateral=0.5, heading_error=0)
    >>> underlying_reward(road, car)
    10.0
    """
    v_x = car.speed * np.cos(car.slip)
    v_y = car.speed * np.sin(car.slip)
    cos = np.cos(car.heading_error)
    sin = np.sin(car.heading_error)
    d = offset(road, car) / OFFSET_SCALE
    return float(v_x * cos - abs(v_y * sin) - 2 * v_x * abs(d * sin) - v_y * cos)
