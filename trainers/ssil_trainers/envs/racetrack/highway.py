"""highway-env's racetracks with the settings that all of our racetracks share."""

from __future__ import annotations

from typing import Literal

import gymnasium
import highway_env  # noqa: F401  registers the simulator's ids
from highway_env.envs.racetrack_env import RacetrackEnv as Simulator

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.counts import check_count
from ssil_trainers.envs.racetrack.kernels import Motion
from ssil_trainers.envs.racetrack.state import CAR_LENGTH, STEERING_LIMIT

__all__ = [
    "HIGHWAY_IDS",
    "POLICY_HZ",
    "SIMULATION_HZ",
    "SPEED_RANGE",
    "Simulator",
    "TrackName",
    "check_task",
    "make_simulator",
    "motion_constants",
]

TrackName = Literal["default", "large", "oval"]
HIGHWAY_IDS: dict[TrackName, str] = {
    "default": "racetrack-v1",
    "large": "racetrack-large-v1",
    "oval": "racetrack-oval-v1",
}
POLICY_HZ = 10
SIMULATION_HZ = 20
SLOWEST_HZ = 4
"""At 2 Hz a car that leaves the road drives 10 m on, beyond the bound of the lateral offset."""
ACCELERATION_LIMIT = 5.0
SPEED_RANGE = (0.0, 20.0)


def check_task(track: TrackName, *, policy_hz: int, other_vehicles: int) -> None:
    """Refuse settings that highway-env cannot simulate.

    At a rate that does not divide its own, it would drive fewer frames than a decision lasts; at
    a slow one, the car would leave the observation space.

    Parameters
    ----------
    track:
        Name of the track.
    policy_hz:
        Decisions a second.
    other_vehicles:
        Most other vehicles.

    Raises
    ------
    InvalidInputError
        For an unknown track, another rate, or a negative count.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.highway import check_task
    >>> check_task("oval", policy_hz=5, other_vehicles=0)
    """
    if track not in HIGHWAY_IDS:
        known = ", ".join(HIGHWAY_IDS)
        raise InvalidInputError(f"track: expected one of {known}, found {track!r}")
    if SIMULATION_HZ % check_count("policy_hz", policy_hz, least=SLOWEST_HZ):
        raise InvalidInputError(
            f"policy_hz: expected a divisor of the simulation's {SIMULATION_HZ} Hz, "
            f"found {policy_hz}"
        )
    check_count("other_vehicles", other_vehicles, least=0)


def make_simulator(
    track: TrackName, *, policy_hz: int, other_vehicles: int, render_mode: str | None
) -> Simulator:
    """Make highway-env's racetrack with the settings of this project.

    Parameters
    ----------
    track, policy_hz, other_vehicles:
        As for `check_task`.
    render_mode:
        None or "rgb_array".

    Returns
    -------
    Simulator
        highway-env's environment, unwrapped.

    Raises
    ------
    InvalidInputError
        For settings that `check_task` refuses.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.highway import make_simulator
    >>> oval = make_simulator("oval", policy_hz=10, other_vehicles=0, render_mode=None)
    >>> oval.config["simulation_frequency"]
    20
    """
    check_task(track, policy_hz=policy_hz, other_vehicles=other_vehicles)
    config = {
        # highway-env must observe something; an empty observation is the fastest.
        "observation": {"type": "AttributesObservation", "attributes": []},
        "action": {
            "type": "ContinuousAction",
            "longitudinal": True,
            "lateral": True,
            "acceleration_range": (-ACCELERATION_LIMIT, ACCELERATION_LIMIT),
            "steering_range": (-STEERING_LIMIT, STEERING_LIMIT),
            "speed_range": SPEED_RANGE,
        },
        "other_vehicles": other_vehicles,
        "policy_frequency": policy_hz,
        "simulation_frequency": SIMULATION_HZ,
        "duration": float("inf"),
    }
    wrapped = gymnasium.make(
        HIGHWAY_IDS[track], config=config, render_mode=render_mode, disable_env_checker=True
    )
    unwrapped = wrapped.unwrapped
    assert isinstance(unwrapped, Simulator)
    return unwrapped


def motion_constants(policy_hz: int) -> Motion:
    """Return the constants of the car's motion.

    Parameters
    ----------
    policy_hz:
        Decisions a second, a divisor of the simulation's 20.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.highway import motion_constants
    >>> motion_constants(5).frames
    4
    """
    slowest, fastest = SPEED_RANGE
    return Motion(
        acceleration=ACCELERATION_LIMIT,
        steering=STEERING_LIMIT,
        car_length=CAR_LENGTH,
        slowest=slowest,
        fastest=fastest,
        seconds=1 / SIMULATION_HZ,
        frames=SIMULATION_HZ // policy_hz,
    )
