"""highway-env's racetrack, seen like a TORCS car: 29 numbers in, throttle and steering out.

The simulator is highway-env's own; this module adds the state, the paper's reward, the end at the
edge of the road and starts anywhere on the lap.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from numpy.typing import NDArray

from ssil_trainers.envs.counts import count
from ssil_trainers.envs.racetrack.highway import (
    HIGHWAY_IDS,
    POLICY_HZ,
    SIMULATION_HZ,
    Track,
    simulator,
)
from ssil_trainers.envs.racetrack.road import Road
from ssil_trainers.envs.racetrack.starts import START_SPEEDS, Start, check_start
from ssil_trainers.envs.racetrack.state import (
    ACTION_NAMES,
    STATE_HIGH,
    STATE_LOW,
    STATE_NAMES,
    Car,
    leaves_road,
    observe,
    underlying_reward,
)
from ssil_trainers.envs.vector import check_options, finite_actions, one_seed

__all__ = [
    "ACTION_NAMES",
    "HIGHWAY_IDS",
    "POLICY_HZ",
    "SIMULATION_HZ",
    "START_SPEEDS",
    "STATE_NAMES",
    "RacetrackEnv",
    "Start",
    "Track",
]

CLEARANCE = 20.0
"""No other vehicle is nearer [m] to a drawn start, as among highway-env's own vehicles."""


class RacetrackEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One car on highway-env's racetrack, 10 decisions a second.

    Action: throttle (±5 m/s²) and steering (±45°), both in [-1, 1]; speeds 0–20 m/s. An episode
    ends when the car leaves the road or hits another vehicle and is cut off after `episode_steps`.
    It starts anywhere on the lap, in the middle of any lane, at 5–15 m/s. The reward is
    `underlying_reward`, for training experts and for evaluation; imitation trainers must not read
    it. info: position (2,) in metres, and after a step underlying_reward.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": POLICY_HZ}  # noqa: RUF012

    def __init__(
        self,
        track: Track = "default",
        *,
        policy_hz: int = POLICY_HZ,
        other_vehicles: int = 0,
        episode_steps: int = 1_000,
        render_mode: str | None = None,
    ) -> None:
        """Build the track.

        policy_hz decisions a second divide the simulation's 20. Of other_vehicles, highway-env's
        own, one drives in the second section, and up to all but one anywhere else, as highway-env
        draws them. `render_mode` is None or "rgb_array".
        """
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": policy_hz}
        self.observation_space = Box(STATE_LOW, STATE_HIGH, dtype=np.float32)
        self.action_space = Box(-1.0, 1.0, (len(ACTION_NAMES),), dtype=np.float32)
        self._simulator = simulator(
            track, policy_hz=policy_hz, other_vehicles=other_vehicles, render_mode=render_mode
        )
        self._road = Road.of(self._simulator.road.network)
        self._start = Start(0, 0.0, 0.0)
        self._episode_steps = count("episode_steps", episode_steps)
        self._steps = -1  # never reset
        self._action = np.zeros(2)

    @property
    def road(self) -> Road:
        """The road's geometry."""
        return self._road

    @property
    def start(self) -> Start:
        """Where this episode started; a reset with `options={"start": start}` starts there."""
        return self._start

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
        """Start at a random place, or at the `Start` that `options` has as "start".

        Raises InvalidInputError for a start that is not on the road, and then nothing has changed.
        """
        check_options(options, ("start",))
        told, seed = (options or {}).get("start"), one_seed(seed)
        start = None if told is None else check_start(told, self._road)
        super().reset(seed=seed)
        self._simulator.reset(seed=seed)
        self._place(self._draw_start() if start is None else start)
        self._action = np.zeros(2)
        self._steps = 0
        car = self.car
        return self._state(car), {"position": np.array([car.x, car.y])}

    def _draw_start(self) -> Start:
        """Draw a start that is clear of other vehicles."""
        while True:
            start = Start.draw(self._road, self.np_random)
            lane = self._simulator.road.network.get_lane(list(self._road.number)[start.lane])
            position = lane.position(start.longitudinal, 0.0)
            away = [np.linalg.norm(other.position - position) for other in self._others()]
            if min(away, default=np.inf) >= CLEARANCE:
                return start

    def _place(self, start: Start) -> None:
        vehicle = self._simulator.vehicle
        lane = self._simulator.road.network.get_lane(list(self._road.number)[start.lane])
        vehicle.position = lane.position(start.longitudinal, 0.0)
        vehicle.heading = lane.heading_at(start.longitudinal)
        vehicle.speed = start.speed
        vehicle.on_state_update()
        self._start = start

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Drive for one decision.

        Raises InvalidInputError for an action that is not finite, and gymnasium's ResetNeeded
        before the first reset.
        """
        if self._steps < 0:
            raise ResetNeeded("the car must be reset first")
        self._action = np.clip(finite_actions(action, self.action_space.shape), -1.0, 1.0)
        self._simulator.step(self._action)
        self._steps += 1
        car = self.car
        reward = underlying_reward(self._road, car)
        info = {"position": np.array([car.x, car.y]), "underlying_reward": reward}
        ended = leaves_road(self._road, car) or self._simulator.vehicle.crashed
        return self._state(car), reward, ended, self._steps >= self._episode_steps, info

    def _state(self, car: Car) -> NDArray[np.float32]:
        boxes = [_sides(other.polygon()) for other in self._others()]
        seen = observe(self._road, car, boxes=np.concatenate(boxes) if boxes else None)
        return seen.astype(np.float32)

    def _others(self) -> list[Any]:
        return [v for v in self._simulator.road.vehicles if v is not self._simulator.vehicle]

    def render(self) -> Any:
        """Return the picture (600, 600, 3) uint8, or None without a render mode."""
        return self._simulator.render() if self.render_mode else None

    def close(self) -> None:
        """Close the viewer."""
        self._simulator.close()


def _sides(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sides (4, 4) of a vehicle's box, whose first corner comes again as the fifth."""
    return np.hstack([corners[:-1], corners[1:]])
