"""Where a training run's demonstrations and leverage come from: a store, or a service as one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from ssil_data.client import RemoteDataset
from ssil_data.commands.output import Place, progress
from ssil_data.commands.serving import open_store
from ssil_data.errors import InvalidInputError
from ssil_data.store.dataset import Dataset
from ssil_trainers.algorithms.methods import METHODS, Demonstrations
from ssil_trainers.training.label_subset import expert_return, score_like, with_labels


@dataclass(frozen=True)
class DataSource:
    """What is learned from.

    Parameters
    ----------
    dataset:
        The demonstrations.
    run:
        The scoring run whose leverage is asked; gail, gail-mixed, constant and clone ask none,
        mixgail only for its kernel's sharpness, which it otherwise fits itself.
    service:
        URL of a service that is asked; without it, one inside this process is.
    labels:
        Take only the first labeled pairs, this many, as if the expert had given no more. The run
        is made again on them if it was not before.
    """

    dataset: str
    run: str | None = None
    service: str | None = None
    labels: int | None = None


@dataclass(frozen=True, eq=False)
class TrainingData:
    """Demonstrations, the expert's mean return if it is known, and JSON that tells them apart."""

    demonstrations: Demonstrations
    expert_return: float | None
    identity: dict[str, Any]

    @classmethod
    def of(
        cls, dataset: Dataset | RemoteDataset, run: str | None, *, threads: int | None = None
    ) -> TrainingData:
        """Read a dataset, and the leverage and field of a run if one is named.

        A field of this process is asked by `threads`, or by all processors.
        """
        pairs = dataset.pairs()
        how: dict[str, Any] = {"threads": threads} if isinstance(dataset, Dataset) else {}
        demonstrations = Demonstrations(
            states=pairs.states,
            actions=pairs.actions,
            labeled=dataset.per_pair("labeled").astype(bool),
            leverage=None if run is None else np.asarray(dataset.leverage(run)),
            field=None if run is None else dataset.field(run, **how),
            threads=threads,
        )
        identity = {"dataset": dataset.name, "version": dataset.version, "run": run}
        return cls(demonstrations, expert_return(dataset), identity)


@contextmanager
def load_training_data(origin: DataSource, method: str, place: Place) -> Iterator[TrainingData]:
    """Open what a method learns from, as long as it learns; one that asks no leverage has none.

    Raises InvalidInputError for a missing run or fewer labels at a service, NotFoundError.
    """
    row = METHODS[method]
    if row.needs_run and origin.run is None:
        raise InvalidInputError(f"{method}: expected --run, whose leverage it asks for, found none")
    run, name = origin.run if row.takes_run else None, origin.dataset
    if origin.labels is not None:
        name = _with_labels(origin, run, place)
    if origin.service is None:
        _check_known(place, name, run)
    with open_store(place, origin.service) as store:
        yield TrainingData.of(store[name], run)


def _check_known(place: Place, name: str, run: str | None) -> None:
    """Refuse what is unknown in the store's words: a service does not say what else it has."""
    dataset = place.open()[name]
    if run is not None:
        _ = dataset.runs[run]


def _with_labels(origin: DataSource, run: str | None, place: Place) -> str:
    """Return the name of the dataset with fewer labels, with its run made."""
    assert origin.labels is not None
    if origin.service is not None:
        raise InvalidInputError(
            "--labels: expected a store, found --service; name a dataset with fewer labels"
        )
    store = place.open()
    dataset = with_labels(store, origin.dataset, origin.labels)
    if run is not None:
        with progress() as report:
            score_like(dataset, store[origin.dataset], run, report)
    return dataset.name
