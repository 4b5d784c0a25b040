"""highway-env's racetrack, seen like a TORCS car: 29 numbers in, throttle and steering out.

The simulator is highway-env's own `racetrack-v1`; this module adds the state, the paper's reward
and random starts. Angles grow from the car's left to its right, as positive steering does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import gymnasium
import highway_env  # noqa: F401  registers the simulator's ids
import numpy as np
from gymnasium.spaces import Box
from highway_env.envs.racetrack_env import RacetrackEnv as HighwayRacetrack
from numpy.typing import NDArray

from ssil_trainers.envs.road import Road

Track = Literal["default", "large", "oval"]
HIGHWAY_IDS: dict[Track, str] = {
    "default": "racetrack-v1",
    "large": "racetrack-large-v1",
    "oval": "racetrack-oval-v1",
}
POLICY_HZ, SIMULATION_HZ = 10, 20
START_SPEEDS = (5.0, 15.0)
"""Speeds [m/s] of the random start: highway-env's own 10, give or take."""

RAY_DEGREES = tuple(range(-90, 91, 10))
RAY_REACH = 60.0
OFFSET_SCALE, SPEED_SCALE, CURVATURE_SCALE = 5.0, 20.0, 20.0
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
_STATE_HIGH = np.array([1.0] * 19 + [np.pi, 3, 1.1, 0.5, 4, 1, 1] + [2.5] * 3, dtype=np.float32)
_STATE_LOW = np.array([0.0] * 19 + [-np.pi, -3, -0.1, -0.5, -4, -1, -1] + [-2.5] * 3, np.float32)


@dataclass(frozen=True)
class Car:
    """What the simulator knows of the car: metres, radians, metres per second.

    lane is a row of `Road`; longitudinal and lateral are measured along and off that lane;
    heading_error is the car's heading less the lane's, in [-π, π); throttle and steering are the
    previous action in [-1, 1].
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
    """Return how far the car is to the right of the road's centre line [m]."""
    return car.lateral + float(road.axis_offset[car.lane])


def observe(road: Road, car: Car) -> NDArray[np.float64]:
    """Return the 29 numbers of `STATE_NAMES` in float64.

    Rays to the edge of the road in units of 60 m (19), heading error [rad], offset from the
    road's centre line in 5 m (1 = the edge of a two-lane road), speeds along and across the car's
    axis in 20 m/s, yaw rate [rad/s], previous action (2), curvature 5, 12 and 22 m ahead in 1/20 m.
    """
    forward, sideways = car.speed * np.cos(car.slip), car.speed * np.sin(car.slip)
    rays = road.ray_distances(car.x, car.y, car.heading + np.deg2rad(RAY_DEGREES), RAY_REACH)
    ahead = [road.curvature_ahead(car.lane, car.longitudinal, far) for far in CURVATURE_AHEAD]
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

    highway-env asks for the closest lane instead, and on the default track two lanes lie 8 cm
    apart: a car that changes lanes there would sometimes be called off the road.
    """
    return bool(abs(offset(road, car)) > road.half_width[car.lane])


def underlying_reward(road: Road, car: Car) -> float:
    """Return the paper's R = v_x cos θ − |v_y sin θ| − 2 v_x |d sin θ| − v_y cos θ.

    Speeds in m/s, so a step at full speed is worth about 20. d is the offset from the road's
    centre line in units of 5 m, which is ±1 at the edges of the two-lane track: TORCS measures
    its `trackPos` so, and in metres the third term would drown the first.
    """
    v_x, v_y = car.speed * np.cos(car.slip), car.speed * np.sin(car.slip)
    cos, sin = np.cos(car.heading_error), np.sin(car.heading_error)
    d = offset(road, car) / OFFSET_SCALE
    return float(v_x * cos - abs(v_y * sin) - 2 * v_x * abs(d * sin) - v_y * cos)


class RacetrackEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One car on highway-env's racetrack, 10 decisions a second.

    Action: throttle (±5 m/s²) and steering (±45°), both in [-1, 1]; speeds 0–20 m/s. An episode
    ends when the car leaves the road and is cut off after `episode_steps`. It starts anywhere on
    the lap, in the middle of any lane, at 5–15 m/s. The reward is `underlying_reward`, for
    training experts and for evaluation; imitation trainers must not read it.
    info: position (x, y) in metres, and after a step underlying_reward.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "render_modes": ["rgb_array"],
        "render_fps": POLICY_HZ,
    }

    def __init__(
        self,
        track: Track = "default",
        *,
        episode_steps: int = 1_000,
        render_mode: str | None = None,
    ) -> None:
        """Build the track; `render_mode` is None or "rgb_array"."""
        self.render_mode = render_mode
        self.observation_space = Box(_STATE_LOW, _STATE_HIGH, dtype=np.float32)
        self.action_space = Box(-1.0, 1.0, (len(ACTION_NAMES),), dtype=np.float32)
        self._simulator = _simulator(track, render_mode)
        self._road = Road.of(self._simulator.road.network)
        self._episode_steps = episode_steps
        self._steps = 0
        self._action = np.zeros(2)

    @property
    def road(self) -> Road:
        """The road's geometry."""
        return self._road

    @property
    def car(self) -> Car:
        """The car as it stands."""
        vehicle = self._simulator.vehicle
        longitudinal, lateral = vehicle.lane.local_coordinates(vehicle.position)
        return Car(
            x=float(vehicle.position[0]),
            y=float(vehicle.position[1]),
            heading=float(vehicle.heading),
            speed=float(vehicle.speed),
            lane=self._road.number[vehicle.lane_index],
            longitudinal=float(longitudinal),
            lateral=float(lateral),
            heading_error=float(vehicle.lane.local_angle(vehicle.heading, longitudinal)),
            throttle=float(self._action[0]),
            steering=float(self._action[1]),
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start at a random place; `options` is not used."""
        super().reset(seed=seed)
        self._simulator.reset(seed=seed)
        self._place()
        self._action = np.zeros(2)
        self._steps = 0
        car = self.car
        return observe(self._road, car).astype(np.float32), {"position": (car.x, car.y)}

    def _place(self) -> None:
        """Put the car anywhere on the lap, every metre equally likely."""
        road, vehicle = self._road, self._simulator.vehicle
        row = self.np_random.choice(len(road.length), p=road.length / road.length.sum())
        lane = self._simulator.road.network.get_lane(list(road.number)[row])
        longitudinal = self.np_random.uniform(0.0, lane.length)
        vehicle.position = lane.position(longitudinal, 0.0)
        vehicle.heading = lane.heading_at(longitudinal)
        vehicle.speed = self.np_random.uniform(*START_SPEEDS)
        vehicle.on_state_update()

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Drive for a tenth of a second."""
        self._action = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        self._simulator.step(self._action)
        self._steps += 1
        car = self.car
        reward = underlying_reward(self._road, car)
        info = {"position": (car.x, car.y), "underlying_reward": reward}
        state = observe(self._road, car).astype(np.float32)
        truncated = self._steps >= self._episode_steps
        return state, reward, leaves_road(self._road, car), truncated, info

    def render(self) -> Any:
        """Return the picture (600, 600, 3) uint8, or None without a render mode."""
        return self._simulator.render() if self.render_mode else None

    def close(self) -> None:
        """Close the viewer."""
        self._simulator.close()


def _simulator(track: Track, render_mode: str | None) -> HighwayRacetrack:
    config = {
        # highway-env must observe something; nothing is the fastest.
        "observation": {"type": "AttributesObservation", "attributes": []},
        "action": {
            "type": "ContinuousAction",
            "longitudinal": True,
            "lateral": True,
            "speed_range": (0, 20),
        },
        "other_vehicles": 0,
        "policy_frequency": POLICY_HZ,
        "simulation_frequency": SIMULATION_HZ,
        "duration": float("inf"),
    }
    made = gymnasium.make(
        HIGHWAY_IDS[track], config=config, render_mode=render_mode, disable_env_checker=True
    )
    simulator = made.unwrapped
    assert isinstance(simulator, HighwayRacetrack)
    return simulator
