"""highway-env's racetrack, seen like a TORCS car: 29 numbers in, throttle and steering out.

The simulator is highway-env's own; this module adds the state, the paper's reward, the end at the
edge of the road and starts anywhere on the lap.
"""

from __future__ import annotations

from typing import Any, Literal

import gymnasium
import highway_env  # noqa: F401  registers the simulator's ids
import numpy as np
from gymnasium.spaces import Box
from highway_env.envs.racetrack_env import RacetrackEnv as HighwayRacetrack
from numpy.typing import NDArray

from ssil_trainers.envs.racetrack_state import (
    ACTION_NAMES,
    STATE_HIGH,
    STATE_LOW,
    STATE_NAMES,
    Car,
    leaves_road,
    observe,
    underlying_reward,
)
from ssil_trainers.envs.road import Road

__all__ = ["ACTION_NAMES", "HIGHWAY_IDS", "STATE_NAMES", "RacetrackEnv", "Track"]

Track = Literal["default", "large", "oval"]
HIGHWAY_IDS: dict[Track, str] = {
    "default": "racetrack-v1",
    "large": "racetrack-large-v1",
    "oval": "racetrack-oval-v1",
}
POLICY_HZ, SIMULATION_HZ = 10, 20
START_SPEEDS = (5.0, 15.0)
"""Speeds [m/s] of the random start: highway-env's own 10, give or take."""


class RacetrackEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One car on highway-env's racetrack, 10 decisions a second.

    Action: throttle (±5 m/s²) and steering (±45°), both in [-1, 1]; speeds 0–20 m/s. An episode
    ends when the car leaves the road and is cut off after `episode_steps`. It starts anywhere on
    the lap, in the middle of any lane, at 5–15 m/s. The reward is `underlying_reward`, for
    training experts and for evaluation; imitation trainers must not read it.
    info: position (x, y) in metres, and after a step underlying_reward.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": POLICY_HZ}  # noqa: RUF012

    def __init__(
        self,
        track: Track = "default",
        *,
        episode_steps: int = 1_000,
        render_mode: str | None = None,
    ) -> None:
        """Build the track; `render_mode` is None or "rgb_array"."""
        self.render_mode = render_mode
        self.observation_space = Box(STATE_LOW, STATE_HIGH, dtype=np.float32)
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
