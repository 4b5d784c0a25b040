"""Where a training run's demonstrations and leverage come from: a store, or a service as one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ssil_data.client import RemoteStore, connect
from ssil_data.commands.output import Place, progress
from ssil_data.errors import InvalidInputError
from ssil_trainers.labels import expert_return, scored_like, with_labels
from ssil_trainers.methods import METHODS, Demonstrations


@dataclass(frozen=True)
class Origin:
    """What is learned from.

    Parameters
    ----------
    dataset:
        The demonstrations.
    run:
        The scoring run whose leverage is asked; gail, gail-mixed, constant and clone ask none.
    service:
        URL of a service to ask instead of the store.
    labels:
        Take only the first labeled pairs, this many, as if the expert had given no more. The run
        is made again on them if it was not before.
    """

    dataset: str
    run: str | None = None
    service: str | None = None
    labels: int | None = None


@dataclass(frozen=True, eq=False)
class Lessons:
    """Demonstrations, the expert's mean return if it is known, and JSON that tells them apart."""

    demonstrations: Demonstrations
    expert_return: float | None
    identity: dict[str, Any]


def open_lessons(origin: Origin, method: str, place: Place) -> Lessons:
    """Open what a method learns from; a method that asks no leverage is given none.

    Raises InvalidInputError for a missing run or fewer labels at a service, NotFoundError.
    """
    run = origin.run if METHODS[method].needs_run else None
    if METHODS[method].needs_run and run is None:
        raise InvalidInputError(f"{method}: expected --run, whose leverage it asks for, found none")
    store = place.open() if origin.service is None else connect(origin.service)
    dataset = store[origin.dataset]
    if origin.labels is not None:
        if isinstance(store, RemoteStore):
            raise InvalidInputError(
                "--labels: expected a store, found --service; name a dataset with fewer labels"
            )
        dataset = with_labels(store, origin.dataset, origin.labels)
        if run is not None:
            with progress() as report:
                scored_like(dataset, store[origin.dataset], run, report)
    pairs = dataset.pairs()
    demonstrations = Demonstrations(
        states=pairs.states,
        actions=pairs.actions,
        labeled=dataset.per_pair("labeled").astype(bool),
        leverage=None if run is None else np.asarray(dataset.leverage(run)),
        field=None if run is None else dataset.field(run),
    )
    identity = {"dataset": dataset.name, "version": dataset.version, "run": run}
    return Lessons(demonstrations, expert_return(dataset), identity)
