"""The command `ssil-data collect`: drive, and write the demonstrations as a dataset.

Every world is a command of its own with its own settings, so that none is taken and not used.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Annotated

from cyclopts import App, Parameter

from ssil_data.commands.output import Place, StorePlace, progress
from ssil_data.errors import ConflictError
from ssil_data.store import Store
from ssil_trainers.collection.racetrack import RacetrackSettings, collect_racetrack
from ssil_trainers.collection.racetrack_card import racetrack_card
from ssil_trainers.collection.rc_lidar import RCSettings, collect_rc
from ssil_trainers.collection.rc_lidar_card import rc_card
from ssil_trainers.envs.racetrack import env as racetrack_env
from ssil_trainers.envs.rc_lidar import env as rc_env

collect = App(name="collect")


@collect.command(name="racetrack")
def racetrack(
    *,
    seed: int = 0,
    name: str = "racetrack",
    settings: Annotated[RacetrackSettings, Parameter(name="*")] = RacetrackSettings(),  # noqa: B008
    place: StorePlace = Place(),  # noqa: B008
) -> None:
    """Train drivers on highway-env's racetrack, let them drive, and write a dataset.

    Parameters
    ----------
    seed:
        The same seed gives the same demonstrations.
    name:
        The dataset's name in the store.
    """
    store, command = _refuse_taken_name(place, name), _command("racetrack", seed, name, settings)
    with progress() as report:
        collected = collect_racetrack(seed=seed, settings=settings, progress=report)
    store.create(
        name,
        collected.episodes(),
        state_names=racetrack_env.STATE_NAMES,
        action_names=racetrack_env.ACTION_NAMES,
        card=racetrack_card(name, collected, command=command),
    )


@collect.command(name="rc-lidar")
def rc_lidar(
    *,
    seed: int = 0,
    name: str = "rc-lidar",
    settings: Annotated[RCSettings, Parameter(name="*")] = RCSettings(),  # noqa: B008
    place: StorePlace = Place(),  # noqa: B008
) -> None:
    """Let an expert drive the RC car, train worse drivers, and write a dataset.

    Parameters
    ----------
    seed:
        The same seed gives the same demonstrations.
    name:
        The dataset's name in the store.
    """
    store, command = _refuse_taken_name(place, name), _command("rc-lidar", seed, name, settings)
    with progress() as report:
        collected = collect_rc(seed=seed, settings=settings, progress=report)
    store.create(
        name,
        collected.episodes(),
        state_names=rc_env.STATE_NAMES,
        action_names=rc_env.ACTION_NAMES,
        card=rc_card(name, collected, command=command),
    )


def _refuse_taken_name(place: Place, name: str) -> Store:
    """Open the store, before anything is trained for a name that is taken."""
    store = place.open()
    if name in store:
        raise ConflictError(f"dataset: expected an unused name in {place.store}, found {name!r}")
    return store


def _command(world: str, seed: int, name: str, settings: RacetrackSettings | RCSettings) -> str:
    """Return the line that makes the dataset again."""
    return " ".join([f"ssil-data collect {world} --seed {seed} --name {name}", *_flags(settings)])


def _flags(settings: RacetrackSettings | RCSettings) -> Iterator[str]:
    """Yield the flags that make these settings of the usual ones."""
    usual = type(settings)()
    for field in fields(settings):
        value = getattr(settings, field.name)
        if value != getattr(usual, field.name):
            yield f"--{field.name.replace('_', '-')} {value}"
