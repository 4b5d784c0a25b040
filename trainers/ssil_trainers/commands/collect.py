"""The command `ssil-data collect`: drive, and write the demonstrations as a dataset.

Every world is a command of its own with its own settings, so that no setting is accepted and then
ignored.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Annotated, Any

from cyclopts import App, Parameter

from ssil_data.commands.output import StoreLocation, StoreOption, progress
from ssil_data.errors import ConflictError
from ssil_trainers.collection.card import render_card
from ssil_trainers.collection.collect import SettingsT, World
from ssil_trainers.collection.collect import collect as collect_demonstrations
from ssil_trainers.collection.racetrack import RACETRACK, RacetrackSettings
from ssil_trainers.collection.rc_lidar import RC_LIDAR, RCSettings

collect = App(name="collect")


@collect.command(name="racetrack")
def racetrack(
    *,
    seed: int = 0,
    name: str = "racetrack",
    settings: Annotated[RacetrackSettings, Parameter(name="*")] = RacetrackSettings(),  # noqa: B008
    location: StoreOption = StoreLocation(),  # noqa: B008
) -> None:
    """Train drivers on highway-env's racetrack, let them drive, and write a dataset.

    Parameters
    ----------
    seed:
        The same seed gives the same demonstrations.
    name:
        The dataset's name in the store.
    """
    write_dataset(RACETRACK, settings, seed=seed, name=name, location=location)


@collect.command(name="rc-lidar")
def rc_lidar(
    *,
    seed: int = 0,
    name: str = "rc-lidar",
    settings: Annotated[RCSettings, Parameter(name="*")] = RCSettings(),  # noqa: B008
    location: StoreOption = StoreLocation(),  # noqa: B008
) -> None:
    """Let an expert drive the RC car, train worse drivers, and write a dataset.

    Parameters
    ----------
    seed:
        The same seed gives the same demonstrations.
    name:
        The dataset's name in the store.
    """
    write_dataset(RC_LIDAR, settings, seed=seed, name=name, location=location)


def write_dataset(
    world: World[SettingsT, Any],
    settings: SettingsT,
    *,
    seed: int,
    name: str,
    location: StoreLocation,
) -> None:
    """Collect demonstrations and write them with their card.

    Parameters
    ----------
    world:
        Where they are collected.
    settings:
        The world's settings.
    seed:
        The same seed gives the same demonstrations.
    name:
        The dataset's name in the store.
    location:
        Where the store is.

    Raises
    ------
    ConflictError
        If there is a dataset of that name; nothing is trained then.
    """
    store = location.open()
    if name in store:
        raise ConflictError(
            f"dataset: {name!r} already exists in {location.store}; choose another name with --name"
        )
    with progress() as report:
        collection = collect_demonstrations(world, settings, seed=seed, progress=report)
    command = " ".join(
        [f"ssil-data collect {world.name} --seed {seed} --name {name}", *_flags(settings)]
    )
    store.create(
        name,
        collection.episodes(),
        state_names=world.state_names,
        action_names=world.action_names,
        card=render_card(collection, name=name, command=command),
    )


def _flags(settings: Any) -> Iterator[str]:
    """Yield the flags of the settings that differ from the defaults."""
    defaults = type(settings)()
    for field in fields(settings):
        value = getattr(settings, field.name)
        if value != getattr(defaults, field.name):
            yield f"--{field.name.replace('_', '-')} {value}"
