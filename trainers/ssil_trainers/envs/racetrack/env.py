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

from ssil_trainers.envs.counts import check_count
from ssil_trainers.envs.racetrack.highway import (
    HIGHWAY_IDS,
    POLICY_HZ,
    SIMULATION_HZ,
    TrackName,
    make_simulator,
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
from ssil_trainers.envs.vector import check_actions, check_options, check_seed

__all__ = [
    "ACTION_NAMES",
    "HIGHWAY_IDS",
    "POLICY_HZ",
    "SIMULATION_HZ",
    "START_SPEEDS",
    "STATE_NAMES",
    "RacetrackEnv",
    "Start",
    "TrackName",
]

CLEARANCE = 20.0
"""No other vehicle is nearer [m] to a drawn start, as among highway-env's own vehicles."""


class RacetrackEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One car on highway-env's racetrack; `gymnasium.make("SSILRacetrack-v0")`.

    Action: throttle (±5 m/s²) and steering (±45°), both in [-1, 1]; speeds 0–20 m/s. An episode
    ends when the car leaves the road or hits another vehicle and is cut off after `episode_steps`.
    It starts anywhere on the lap, in the middle of any lane, at 5–15 m/s. The reward is
    `underlying_reward`, for training experts and for evaluation; imitation trainers must not read
    it. info: position (2,) in meters, and after a step underlying_reward.

    Parameters
    ----------
    track:
        "default", "large" or "oval".
    policy_hz:
        Decisions a second, a divisor of the simulation's 20 and at least 4.
    other_vehicles:
        highway-env's own traffic: one drives in the second section, and up to all but one anywhere
        else, as highway-env draws them.
    episode_steps:
        Time limit of an episode.
    render_mode:
        None or "rgb_array".

    Raises
    ------
    InvalidInputError
        For settings that highway-env cannot simulate.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.env import RacetrackEnv
    >>> env = RacetrackEnv("oval")
    >>> state, info = env.reset(seed=0)
    >>> state, reward, terminated, truncated, info = env.step(np.array([0.5, 0.0]))
    >>> state.shape, bool(terminated), sorted(info)
    ((29,), False, ['position', 'underlying_reward'])
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": POLICY_HZ}  # noqa: RUF012

    def __init__(
        self,
        track: TrackName = "default",
        *,
        policy_hz: int = POLICY_HZ,
        other_vehicles: int = 0,
        episode_steps: int = 1_000,
        render_mode: str | None = None,
    ) -> None:
        """Build the track; the car is not on it before `reset`."""
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": policy_hz}
        self.observation_space = Box(STATE_LOW, STATE_HIGH, dtype=np.float32)
        self.action_space = Box(-1.0, 1.0, (len(ACTION_NAMES),), dtype=np.float32)
        self._simulator = make_simulator(
            track, policy_hz=policy_hz, other_vehicles=other_vehicles, render_mode=render_mode
        )
        self._road = Road.from_network(self._simulator.road.network)
        self._start = Start(0, 0.0, 0.0)
        self._episode_steps = check_count("episode_steps", episode_steps)
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
        """Start at a random place, or at a given one.

        Parameters
        ----------
        seed:
            Draws the start and the traffic; None goes on with the random numbers so far.
        options:
            May have "start", a `Start`.

        Returns
        -------
        state, info
            What the car sees (29,), and its position (2,) [m].

        Raises
        ------
        InvalidInputError
            For a start that is not on the road; then nothing has changed.
        """
        check_options(options, ("start",))
        seed = check_seed(seed)
        requested = (options or {}).get("start")
        start = None if requested is None else check_start(requested, self._road)
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
        """Put highway-env's vehicle at a start."""
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

        Parameters
        ----------
        action:
            Throttle and steering (2,), clipped to [-1, 1].

        Returns
        -------
        state, reward, terminated, truncated, info
            What the car sees (29,), the underlying reward, whether it left the road or hit another
            vehicle, whether the time limit is reached, and position and underlying reward.

        Raises
        ------
        InvalidInputError
            For an action that is not finite.
        gymnasium.error.ResetNeeded
            Before the first reset.
        """
        if self._steps < 0:
            raise ResetNeeded("the car must be reset first")
        self._action = np.clip(check_actions(action, self.action_space.shape), -1.0, 1.0)
        self._simulator.step(self._action)
        self._steps += 1
        car = self.car
        reward = underlying_reward(self._road, car)
        info = {"position": np.array([car.x, car.y]), "underlying_reward": reward}
        ended = leaves_road(self._road, car) or self._simulator.vehicle.crashed
        return self._state(car), reward, ended, self._steps >= self._episode_steps, info

    def _state(self, car: Car) -> NDArray[np.float32]:
        """Return what the car sees (29,)."""
        boxes = [_sides(other.polygon()) for other in self._others()]
        state = observe(self._road, car, boxes=np.concatenate(boxes) if boxes else None)
        return state.astype(np.float32)

    def _others(self) -> list[Any]:
        """Return all vehicles but the car."""
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
