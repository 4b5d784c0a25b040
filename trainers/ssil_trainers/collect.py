"""The command `ssil-data collect`: drive, and write the demonstrations as a dataset."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Annotated, Literal

from cyclopts import Parameter

from ssil_data.commands.output import Place, StorePlace, progress
from ssil_data.errors import ConflictError
from ssil_trainers.envs import racetrack as racetrack_env
from ssil_trainers.envs import rc_lidar as rc_env
from ssil_trainers.racetrack_card import racetrack_card
from ssil_trainers.racetrack_demonstrations import RacetrackSettings, collect_racetrack
from ssil_trainers.rc_card import rc_card
from ssil_trainers.rc_demonstrations import RCSettings, collect_rc

World = Literal["racetrack", "rc-lidar"]
_NAMES = {
    "racetrack": (racetrack_env.STATE_NAMES, racetrack_env.ACTION_NAMES),
    "rc-lidar": (rc_env.STATE_NAMES, rc_env.ACTION_NAMES),
}


def collect(
    world: World,
    /,
    *,
    seed: int = 0,
    name: str | None = None,
    racetrack: Annotated[RacetrackSettings, Parameter(name="*")] = RacetrackSettings(),  # noqa: B008
    rc: RCSettings = RCSettings(),  # noqa: B008
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
    settings, prefix = (racetrack, "") if world == "racetrack" else (rc, "rc.")
    flags = " ".join(_flags(settings, prefix))
    command = f"ssil-data collect {world} --seed {seed} --name {name} {flags}".strip()
    with progress() as report:
        if isinstance(settings, RacetrackSettings):
            collected = collect_racetrack(seed=seed, settings=settings, progress=report)
            card = racetrack_card(name, collected, command=command)
        else:
            collected = collect_rc(seed=seed, settings=settings, progress=report)
            card = rc_card(name, collected, command=command)
    states, actions = _NAMES[world]
    store.create(name, collected.episodes(), state_names=states, action_names=actions, card=card)


def _flags(settings: RacetrackSettings | RCSettings, prefix: str) -> Iterator[str]:
    """Yield the command-line flags that make these settings of the usual ones."""
    usual = type(settings)()
    for field in fields(settings):
        value = getattr(settings, field.name)
        if value != getattr(usual, field.name):
            yield f"--{prefix}{field.name.replace('_', '-')} {value}"
