"""Where an episode on the racetrack starts: drawn from a generator, or told by the caller."""

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
    """The middle of a lane: its row in `Road.lanes`, metres along it, speed [m/s]."""

    lane: int
    longitudinal: float
    speed: float

    @classmethod
    def draw(cls, road: Road, rng: np.random.Generator) -> Start:
        """Draw a place on the lap, every metre of every lane equally likely, and a speed."""
        # What rng.choice(lanes, p=length / length.sum()) does, without its checks.
        lane = int(np.searchsorted(road.shares, rng.random(), side="right"))
        longitudinal = rng.uniform(0.0, road.lanes.length[lane])
        return cls(lane, longitudinal, rng.uniform(*START_SPEEDS))

    def on(self, road: Road) -> Start:
        """Return it, if there is such a place; raises InvalidInputError."""
        lanes, (slowest, fastest) = len(road.lanes.length), SPEED_RANGE
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


def check_start(told: object, road: Road) -> Start:
    """Return what the caller told, if it is a start on the road; raises InvalidInputError."""
    if not isinstance(told, Start):
        raise InvalidInputError(f"start: expected a Start, found {told!r}")
    return told.on(road)


def check_starts(told: object, road: Road, which: NDArray[np.bool_]) -> list[Start]:
    """Return those of the told starts, one for each car, that the cars of the mask (n,) begin at.

    Raises InvalidInputError for another number of them, or for one that is no start on the road.
    """
    if not isinstance(told, list | tuple) or len(told) != len(which):
        found = len(told) if isinstance(told, list | tuple) else repr(told)
        raise InvalidInputError(f"start: expected one for each of {len(which)} cars, found {found}")
    return [check_start(told[car], road) for car in np.flatnonzero(which)]
