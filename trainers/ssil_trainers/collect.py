"""The command `ssil-data collect`: drive, and write the demonstrations as a dataset."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Annotated, Literal

from cyclopts import Parameter

from ssil_data.commands.output import Place, StorePlace, progress
from ssil_data.errors import ConflictError
from ssil_trainers.envs.racetrack import ACTION_NAMES, STATE_NAMES
from ssil_trainers.racetrack_card import racetrack_card
from ssil_trainers.racetrack_demonstrations import RacetrackSettings, collect_racetrack

World = Literal["racetrack"]


def collect(
    world: World,
    /,
    *,
    seed: int = 0,
    name: str | None = None,
    racetrack: Annotated[RacetrackSettings, Parameter(name="*")] = RacetrackSettings(),  # noqa: B008
    place: StorePlace = Place(),  # noqa: B008
) -> None:
    """Train drivers, let them drive, and write the demonstrations as a dataset.

    Parameters
    ----------
    world:
        Where they drive.
    seed:
        The same seed gives the same demonstrations.
    name:
        The dataset's name in the store; without it, the world's.
    """
    store, name = place.open(), name or world
    if name in store:
        raise ConflictError(f"dataset: expected an unused name in {place.store}, found {name!r}")
    with progress() as report:
        collected = collect_racetrack(seed=seed, settings=racetrack, progress=report)
    flags = " ".join(_flags(racetrack))
    command = f"ssil-data collect {world} --seed {seed} --name {name} {flags}".strip()
    store.create(
        name,
        collected.episodes(),
        state_names=STATE_NAMES,
        action_names=ACTION_NAMES,
        card=racetrack_card(name, collected, command=command),
    )


def _flags(settings: RacetrackSettings) -> Iterator[str]:
    """Yield the command-line flags that make these settings of the usual ones."""
    usual = RacetrackSettings()
    for field in fields(settings):
        value = getattr(settings, field.name)
        if value != getattr(usual, field.name):
            yield f"--{field.name.replace('_', '-')} {value}"
