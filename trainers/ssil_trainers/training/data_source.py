"""The training command's choice of demonstrations and leverage: from a store, or from a service."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from ssil_data.commands.output import StoreLocation, progress
from ssil_data.commands.serving import open_store
from ssil_data.errors import InvalidInputError
from ssil_data.store.run_record import Run
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.training.data import TrainingData
from ssil_trainers.training.label_subset import limit_labels, score_like


@dataclass(frozen=True)
class DataSource:
    """Which demonstrations to learn from.

    Parameters
    ----------
    dataset:
        Name of the demonstrations.
    run:
        Scoring run whose leverage is used. gail, gail-mixed, constant and clone use none; mixgail
        is the same with any and with none.
    service:
        URL of a service that computes the rewards; without it, a service embedded in this process
        does.
    labels:
        Use only the first labeled pairs, this many, as if the expert had given fewer. The scoring
        run is made again on them unless it exists already.
    """

    dataset: str
    run: str | None = None
    service: str | None = None
    labels: int | None = None


@contextmanager
def load_training_data(
    source: DataSource, method: str, location: StoreLocation
) -> Iterator[TrainingData]:
    """Read what a method learns from; the service stays open inside the block.

    Where the method uses the leverage of a run that is weak, a line on standard error says why.

    Parameters
    ----------
    source:
        Which demonstrations, run and service.
    method:
        Name of the method; one that uses no leverage is given none.
    location:
        The store, for an embedded service and for fewer labels.

    Raises
    ------
    InvalidInputError
        If the method needs a run and none is named, or for fewer labels at a service.
    NotFoundError
        For an unknown dataset or run.
    """
    row = METHODS[method]
    if row.requires_run and source.run is None:
        raise InvalidInputError(f"{method}: needs the leverage of a scoring run; name it by --run")
    run = source.run if row.uses_run else None
    name = source.dataset if source.labels is None else _limit_labels(source, run, location)
    if source.service is None:
        _check_exists(location, name, run)
    with open_store(location, source.service) as store:
        dataset = store[name]
        data = TrainingData.read(dataset, run)
        if run is not None and row.requires_run:  # MixGAIL reads no leverage
            _warn(dataset.runs[run])
        yield data


def _warn(run: Run) -> None:
    """Print why a run is weak, in one line; nothing for one that is not."""
    if run.weak:
        print(f"Weak: {run.name}: {'; '.join(run.weak)}", file=sys.stderr)


def _check_exists(location: StoreLocation, name: str, run: str | None) -> None:
    """Raise the store's NotFoundError, which lists what there is; a service's does not."""
    dataset = location.open()[name]
    if run is not None:
        _ = dataset.runs[run]


def _limit_labels(source: DataSource, run: str | None, location: StoreLocation) -> str:
    """Make the dataset with fewer labels, and the run on it; return the dataset's name."""
    assert source.labels is not None
    if source.service is not None:
        raise InvalidInputError(
            "--labels works on a store, not with --service; name a dataset with fewer labels"
        )
    store = location.open()
    dataset = limit_labels(store, source.dataset, source.labels)
    if run is not None:
        with progress() as report:
            score_like(dataset, store[source.dataset], run, report)
    return dataset.name
