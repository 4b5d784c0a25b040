"""Where an episode on the racetrack starts: drawn from a generator, or given by the caller."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.racetrack.highway import SPEED_RANGE
from ssil_trainers.envs.racetrack.road import Road

START_SPEEDS = (5.0, 15.0)
"""Speeds [m/s] of the random start: highway-env's own 10, give or take."""


@dataclass(frozen=True)
class Start:
    """A start in the middle of a lane.

    Parameters
    ----------
    lane:
        Row of the lane in `Road.lanes`.
    longitudinal:
        Meters along it.
    speed:
        Speed of the car [m/s].

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.env import RacetrackEnv
    >>> from ssil_trainers.envs.racetrack.starts import Start
    >>> env = RacetrackEnv("oval")
    >>> state, info = env.reset(options={"start": Start(lane=0, longitudinal=20.0, speed=10.0)})
    >>> env.car.speed
    10.0
    """

    lane: int
    longitudinal: float
    speed: float

    @classmethod
    def draw(cls, road: Road, rng: np.random.Generator) -> Start:
        """Draw a place on the lap, every meter of every lane equally likely, and a speed.

        Parameters
        ----------
        road:
            The road.
        rng:
            Generator that three numbers are drawn from.
        """
        # What rng.choice(lanes, p=length / length.sum()) does, without its checks.
        lane = int(np.searchsorted(road.shares, rng.random(), side="right"))
        longitudinal = rng.uniform(0.0, road.lanes.length[lane])
        return cls(lane, longitudinal, rng.uniform(*START_SPEEDS))

    def validate(self, road: Road) -> Start:
        """Return the start itself if the road has such a place.

        Parameters
        ----------
        road:
            The road.

        Raises
        ------
        InvalidInputError
            If there is no such lane, place or speed.
        """
        lanes = len(road.lanes.length)
        slowest, fastest = SPEED_RANGE
        if not isinstance(self.lane, int | np.integer):
            raise InvalidInputError(f"start: expected a lane by its row, found {self}")
        if not 0 <= self.lane < lanes:
            raise InvalidInputError(f"start: expected a lane from 0 to {lanes - 1}, found {self}")
        if not 0 <= self.longitudinal <= road.lanes.length[self.lane]:
            length = road.lanes.length[self.lane]
            raise InvalidInputError(f"start: expected 0 to {length:g} m along it, found {self}")
        if not slowest <= self.speed <= fastest:
            raise InvalidInputError(
                f"start: expected a speed from {slowest:g} to {fastest:g} m/s, found {self}"
            )
        return self


def check_start(value: object, road: Road) -> Start:
    """Return a start that the caller gave, if it is on the road.

    Parameters
    ----------
    value:
        What the caller gave.
    road:
        The road.

    Raises
    ------
    InvalidInputError
        If it is no `Start`, or not on the road.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.env import RacetrackEnv
    >>> from ssil_trainers.envs.racetrack.starts import Start, check_start
    >>> check_start(Start(0, 20.0, 10.0), RacetrackEnv("oval").road)
    Start(lane=0, longitudinal=20.0, speed=10.0)
    """
    if not isinstance(value, Start):
        raise InvalidInputError(f"start: expected a Start, found {value!r}")
    return value.validate(road)


def check_starts(values: object, road: Road, which: NDArray[np.bool_]) -> list[Start]:
    """Return the starts that the caller gave for the cars that begin an episode.

    Parameters
    ----------
    values:
        What the caller gave: one for each car.
    road:
        The road.
    which:
        True for the cars that begin (n,).

    Raises
    ------
    InvalidInputError
        For another number of starts, or one of these cars' that is no start on the road.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.env import RacetrackEnv
    >>> from ssil_trainers.envs.racetrack.starts import Start, check_starts
    >>> starts = [Start(0, 20.0, 10.0), Start(1, 5.0, 8.0)]
    >>> check_starts(starts, RacetrackEnv("oval").road, np.array([False, True]))
    [Start(lane=1, longitudinal=5.0, speed=8.0)]
    """
    if not isinstance(values, list | tuple) or len(values) != len(which):
        found = len(values) if isinstance(values, list | tuple) else repr(values)
        raise InvalidInputError(f"start: expected one for each of {len(which)} cars, found {found}")
    return [check_start(values[car], road) for car in np.flatnonzero(which)]
