"""The RC car as settings, and a fleet of them side by side; knows no gymnasium."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.counts import count
from ssil_trainers.envs.rc_lidar import kernels as rc_kernel
from ssil_trainers.envs.rc_lidar.kernels import World
from ssil_trainers.envs.rc_lidar.lidar import directions_of
from ssil_trainers.envs.rc_lidar.track import Track

BEAM_DEGREES = tuple(range(-90, 91, 10))
ACTION_NAMES = ("steering",)
STATE_NAMES = (*(f"beam {degrees}°" for degrees in BEAM_DEGREES), "previous steering")
_START_SPACING = 0.1
_ASKEW = 5.0
"""Starts are tried at angles so many degrees apart, and at the largest."""


@dataclass(frozen=True)
class RCCar:
    """A car of a tenth of the size, driven at one speed.

    Parameters
    ----------
    speed:
        Speed of the rear axle [m/s].
    hz:
        Decisions a second.
    substeps:
        Steps of the simulation between two decisions; collisions are looked for after each.
    wheelbase:
        From rear axle to front axle [m].
    steering_degrees:
        Angle of the wheels at full steering, to the left for 1, to the right for -1.
    steering_lag:
        Time constant of the wheels' angle [s]; 0 turns them at once.
    overhang:
        From an axle to the bumper [m], at either end.
    width:
        Width of the car [m].
    lidar:
        How far the LiDAR is ahead of the rear axle [m].
    reach:
        Longest range [m]; it stands for all that is farther.
    noise:
        Deviation of the normal noise on a range, as a share of it.
    start_aside:
        Largest distance of the start from the centre line [m].
    start_askew_degrees:
        Largest angle of the start to the centre line.
    """

    speed: float = 4.0
    hz: float = 10.0
    substeps: int = 5
    wheelbase: float = 0.33
    steering_degrees: float = 24.0
    steering_lag: float = 0.15
    overhang: float = 0.09
    width: float = 0.27
    lidar: float = 0.275
    reach: float = 10.0
    noise: float = 0.02
    start_aside: float = 0.1
    start_askew_degrees: float = 5.0

    def __post_init__(self) -> None:
        """Refuse what cannot drive."""
        may_be_zero = {"steering_lag", "overhang", "lidar", "noise"}
        may_be_zero |= {"start_aside", "start_askew_degrees"}
        for field in fields(self):
            value = getattr(self, field.name)
            if not (0 < value < np.inf or (value == 0 and field.name in may_be_zero)):
                least = "at least 0" if field.name in may_be_zero else "above 0"
                raise InvalidInputError(
                    f"{field.name}: expected a finite number {least}, found {value}"
                )
        count("substeps", self.substeps)
        if self.start_askew_degrees > 180:
            raise InvalidInputError(
                f"start_askew_degrees: expected at most 180, found {self.start_askew_degrees}"
            )
        if self.steering_degrees >= 90:
            raise InvalidInputError(
                f"steering_degrees: expected less than 90, found {self.steering_degrees}"
            )

    def on(self, track: Track) -> World:
        """Return the world of this car on that track, for the compiled loops.

        Raises InvalidInputError, with the row, if a car could start in a wall.
        """
        world = self._world(track)
        blocked = rc_kernel.find_blocked_start(world, self._turns())
        if blocked >= 0:
            x, y, _ = world.starts[blocked]
            row = int(np.argmin(np.hypot(*(track.centre - [x, y]).T)))
            raise InvalidInputError(
                f"track {track.name}, row {row}: expected room for a car of {self.width:g} × "
                f"{world.front - world.rear:.3g} m to start {self.start_aside:g} m aside and "
                f"{self.start_askew_degrees:g}° askew, found a wall in it"
            )
        return world

    def _turns(self) -> NDArray[np.float64]:
        """Return angles of a start to the line [rad], close enough that no corner slips through."""
        steps = int(np.ceil(self.start_askew_degrees / _ASKEW))
        widest = np.deg2rad(self.start_askew_degrees)
        return np.linspace(-widest, widest, 2 * steps + 1)

    def _world(self, track: Track) -> World:
        return World(
            grid=track.walls.grid,
            starts=track.places(_START_SPACING),
            beams=directions_of(np.deg2rad(BEAM_DEGREES)),
            reach=float(self.reach),
            noise=float(self.noise),
            lidar=float(self.lidar),
            rear=-float(self.overhang),
            front=float(self.wheelbase + self.overhang),
            half=self.width / 2,
            wheelbase=float(self.wheelbase),
            speed=float(self.speed),
            steering=float(np.deg2rad(self.steering_degrees)),
            lag=float(self.steering_lag),
            period=1 / self.hz,
            substeps=int(self.substeps),
            aside=float(self.start_aside),
            askew=float(np.deg2rad(self.start_askew_degrees)),
        )

    def lap_steps(self, track: Track) -> int:
        """Return how many decisions one lap down the centre line takes."""
        return max(1, round(track.length / self.speed * self.hz))


class Fleet:
    """Cars on one track, each with its own randomness: none depends on who drives beside it."""

    def __init__(self, car: RCCar, track: Track, cars: int) -> None:
        """Build the world; no car stands on it before `seed` and `begin`."""
        self.car, self.track, self.world = car, track, car.on(track)
        self.rows = rc_kernel.Cars(
            pose=np.zeros((cars, 3)),
            wheels=np.zeros(cars),
            steering=np.zeros(cars),
            key=np.zeros(cars, dtype=np.uint64),
            episode=np.full(cars, -1),
            steps=np.zeros(cars, dtype=np.int64),
        )
        self.hits = np.zeros(cars, dtype=np.bool_)
        self._begun = np.zeros(cars, dtype=np.bool_)
        self._states = np.zeros((cars, len(STATE_NAMES)))

    def __len__(self) -> int:
        """Count the cars."""
        return len(self.hits)

    def seed(self, seeds: Sequence[int | None]) -> None:
        """Give cars new randomness; None lets a car keep its own."""
        for row, seed in enumerate(seeds):
            if seed is not None:
                self.rows.key[row] = np.random.SeedSequence(seed).generate_state(1, np.uint64)[0]
                self.rows.episode[row] = -1

    def begin(self, which: NDArray[np.bool_]) -> None:
        """Begin the next episode of those cars (n,)."""
        if which.any():
            rc_kernel.begin(self.world, self.rows, which, self._states)
            self._begun |= which

    def advance(self, which: NDArray[np.bool_], actions: NDArray[np.float64]) -> None:
        """Drive those cars (n,) for one period by their actions (n,); `hits` tells who hit."""
        rc_kernel.advance(self.world, self.rows, which, actions, self._states, self.hits)

    @property
    def is_placed(self) -> NDArray[np.bool_]:
        """Which cars (n,) stand on the track."""
        return self._begun.copy()

    @property
    def states(self) -> NDArray[np.float32]:
        """What the cars see (n, 20), a copy."""
        return self._states.astype(np.float32)

    def ranges(self, car: int) -> NDArray[np.float64]:
        """What the car's beams read (19,), as shares of the reach, a copy."""
        return self._states[car, :-1].copy()

    @property
    def positions(self) -> NDArray[np.float64]:
        """x, y of the rear axles (n, 2) [m], a copy."""
        return self.rows.pose[:, :2].copy()
