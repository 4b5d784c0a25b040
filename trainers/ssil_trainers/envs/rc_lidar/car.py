"""The RC car as settings, and a fleet of them side by side; knows no gymnasium."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.counts import check_count
from ssil_trainers.envs.rc_lidar import kernels
from ssil_trainers.envs.rc_lidar.kernels import Beams, Cars, Output, World
from ssil_trainers.envs.rc_lidar.lidar import unit_vectors
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
        Greatest range [m]; a beam that meets nothing nearer reads it.
    noise:
        Deviation of the normal noise on a range, as a share of it.
    start_aside:
        Largest distance of the start from the center line [m].
    start_askew_degrees:
        Largest angle of the start to the center line.

    Raises
    ------
    InvalidInputError
        For numbers that no car can have.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.car import RCCar
    >>> from ssil_trainers.envs.rc_lidar.tracks import find_track
    >>> RCCar(speed=2.0).lap_steps(find_track("hall"))
    800
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
        """Refuse numbers that no car can have."""
        may_be_zero = {
            "steering_lag",
            "overhang",
            "lidar",
            "noise",
            "start_aside",
            "start_askew_degrees",
        }
        for field in fields(self):
            value = getattr(self, field.name)
            if not (0 < value < np.inf or (value == 0 and field.name in may_be_zero)):
                least = "at least 0" if field.name in may_be_zero else "above 0"
                raise InvalidInputError(
                    f"{field.name}: expected a finite number {least}, found {value}"
                )
        check_count("substeps", self.substeps)
        if self.start_askew_degrees > 180:
            raise InvalidInputError(
                f"start_askew_degrees: expected at most 180, found {self.start_askew_degrees}"
            )
        if self.steering_degrees >= 90:
            raise InvalidInputError(
                f"steering_degrees: expected less than 90, found {self.steering_degrees}"
            )

    def build_world(self, track: Track) -> World:
        """Return the world of this car on a track, for the compiled loops.

        Parameters
        ----------
        track:
            Where the car drives.

        Returns
        -------
        World
            Walls, starts, beams and car as plain numbers.

        Raises
        ------
        InvalidInputError
            If a car could start in a wall, with the row of the track.
        """
        world = self._world(track)
        blocked = kernels.find_blocked_start(world, self._turns())
        if blocked >= 0:
            x, y, _ = world.starts[blocked].tolist()
            row = int(np.argmin(np.hypot(*(track.center - [x, y]).T)))
            raise InvalidInputError(
                f"track {track.name}, row {row}: expected room for a car of {self.width:g} × "
                f"{world.front - world.rear:.3g} m to start {self.start_aside:g} m aside and "
                f"{self.start_askew_degrees:g}° askew, found a wall in it"
            )
        return world

    def _turns(self) -> NDArray[np.float64]:
        """Return the angles of a start that are tried [rad], so close that no wall fits between."""
        steps = int(np.ceil(self.start_askew_degrees / _ASKEW))
        widest = np.deg2rad(self.start_askew_degrees)
        return np.linspace(-widest, widest, 2 * steps + 1)

    def _world(self, track: Track) -> World:
        """Return the world, whether or not the car finds room in it."""
        return World(
            grid=track.walls.grid,
            starts=track.sample_poses(_START_SPACING),
            beams=Beams(unit_vectors(np.deg2rad(BEAM_DEGREES)), float(self.reach)),
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
        """Return how many decisions one lap down the center line takes.

        Parameters
        ----------
        track:
            Where the car drives.
        """
        return max(1, round(track.length / self.speed * self.hz))


class Fleet:
    """Cars on one track, each with its own randomness: no car depends on those beside it.

    Parameters
    ----------
    car:
        The car that all of them are.
    track:
        Where they drive.
    count:
        Number of cars n; none stands on the track before `seed` and `begin`.

    Raises
    ------
    InvalidInputError
        If a car could start in a wall.

    Examples
    --------
    >>> from ssil_trainers.envs.rc_lidar.car import Fleet, RCCar
    >>> from ssil_trainers.envs.rc_lidar.tracks import find_track
    >>> fleet = Fleet(RCCar(), find_track("hall"), 2)
    >>> fleet.seed([0, 1])
    >>> fleet.begin(np.array([True, True]))
    >>> fleet.drive(np.array([True, False]), np.array([0.5, 0.0]))
    >>> fleet.cars.steps.tolist(), fleet.states.shape
    ([1, 0], (2, 20))
    """

    def __init__(self, car: RCCar, track: Track, count: int) -> None:
        """Build the world."""
        self.car = car
        self.track = track
        self.world = car.build_world(track)
        self.cars = Cars.allocate(count)
        self._output = Output(
            states=np.zeros((count, len(STATE_NAMES))), hits=np.zeros(count, dtype=np.bool_)
        )
        self._placed = np.zeros(count, dtype=np.bool_)

    def __len__(self) -> int:
        """Count the cars."""
        return len(self._placed)

    def seed(self, seeds: Sequence[int | None]) -> None:
        """Give cars new randomness.

        Parameters
        ----------
        seeds:
            One for each car; None lets a car keep its own.
        """
        for row, seed in enumerate(seeds):
            if seed is not None:
                self.cars.key[row] = np.random.SeedSequence(seed).generate_state(1, np.uint64)[0]
                self.cars.episode[row] = -1

    def begin(self, which: NDArray[np.bool_]) -> None:
        """Begin the next episode of some cars.

        Parameters
        ----------
        which:
            True for the cars to place (n,).
        """
        if which.any():
            kernels.begin_episodes(self.world, self.cars, which, self._output.states)
            self._placed |= which

    def drive(self, which: NDArray[np.bool_], actions: NDArray[np.float64]) -> None:
        """Drive some cars for one period; `hits` tells which of them hit a wall.

        Parameters
        ----------
        which:
            True for the cars to drive (n,).
        actions:
            Steering of every car (n,), clipped to [-1, 1].
        """
        kernels.drive_cars(self.world, self.cars, which, actions, self._output)

    @property
    def hits(self) -> NDArray[np.bool_]:
        """Which cars (n,) hit a wall in the last `drive`, a copy."""
        return self._output.hits.copy()

    @property
    def is_placed(self) -> NDArray[np.bool_]:
        """Which cars (n,) stand on the track, a copy."""
        return self._placed.copy()

    @property
    def states(self) -> NDArray[np.float32]:
        """What the cars see (n, 20), a copy."""
        return self._output.states.astype(np.float32)

    def ranges(self, car: int) -> NDArray[np.float64]:
        """Return what one car's beams read, as shares of the reach (19,), a copy.

        Parameters
        ----------
        car:
            Row of the car.
        """
        return self._output.states[car, :-1].copy()

    @property
    def positions(self) -> NDArray[np.float64]:
        """x, y of the rear axles (n, 2) [m], a copy."""
        return self.cars.pose[:, :2].copy()
