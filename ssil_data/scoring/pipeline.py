"""From a recipe to a run: fit on the labeled pairs, stream every pair through, scale, commit."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any, Protocol, Self, TypeVar, overload

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data import scales
from ssil_data.demonstrations import Pairs
from ssil_data.errors import ConflictError, InvalidInputError
from ssil_data.estimators import Estimator, Fitted, dump
from ssil_data.estimators.label_split import split_held_out
from ssil_data.features import Standardizer
from ssil_data.field import auto_alpha
from ssil_data.leverage_model import LeverageModel
from ssil_data.scales import Conformal, Scale
from ssil_data.scoring.recipes import Recipe
from ssil_data.scoring.streaming import Streamed, stream
from ssil_data.store.arrow_schema import PARTS
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run
from ssil_data.store.runs import digest

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""


class ServedDataset(Protocol):
    """A dataset whose runs are made elsewhere: the client's, behind a service."""

    def score(
        self,
        recipe: Recipe | Estimator,
        /,
        *,
        seed: int = 0,
        run: str | None = None,
        progress: Progress | None = None,
    ) -> Run:
        """Do what `score` does, where the dataset is.

        Parameters
        ----------
        recipe, seed, run, progress
            See `score`.
        """
        ...

    def rescore(
        self,
        source: Self,
        source_run: str,
        /,
        *,
        run: str | None = None,
        progress: Progress | None = None,
    ) -> Run:
        """Do what `rescore` does, where both datasets are.

        Parameters
        ----------
        source, source_run, run, progress
            See `rescore`.
        """
        ...


Served = TypeVar("Served", bound=ServedDataset)


def score(
    dataset: Dataset | ServedDataset,
    recipe: Recipe | Estimator,
    *,
    seed: int = 0,
    run: str | None = None,
    progress: Progress | None = None,
) -> Run:
    """Give every pair of a dataset a leverage in [0, 1] and commit it as one run.

    The estimator is fitted on the labeled pairs. Memory: some 40 bytes a pair beside a row group,
    however wide a state is.

    Parameters
    ----------
    dataset
        The dataset, local or behind a service; its labeled episodes are the expert's.
    recipe
        How: a recipe, or an estimator, which then goes with the quantile scale.
    seed
        Of the fit. Same seed, same machine, same bytes.
    run
        Name of the run; the estimator's kind, numbered, unless given.
    progress
        Called with what is being done, how much of it is done, and how much there is.

    Returns
    -------
    Run
        The record of the run.

    Raises
    ------
    InvalidInputError
        Without labeled pairs; nothing is written then.
    ConflictError
        If a run of that name exists; nothing is written then.

    Examples
    --------
    >>> run = sd.score(dataset, sd.VAE(steps=20), seed=0, run="mine")
    >>> leverage = dataset.leverage(run.name)
    >>> leverage.shape == (len(dataset),), bool(leverage.min() >= 0), bool(leverage.max() <= 1)
    (True, True, True)
    """
    if not isinstance(dataset, Dataset):
        return dataset.score(recipe, seed=seed, run=run, progress=progress)
    started_at = time.perf_counter()
    recipe = Recipe.of(recipe)
    report = progress or _ignore_progress
    if run is not None:
        dataset.runs.check_unused(run)
    labeled, held_out = _read_labeled(dataset, recipe.scale, seed)
    report("fit", 0, 1)
    fitted = recipe.estimator.fit(labeled, seed=seed)
    report("fit", 1, 1)
    residuals = None if held_out is None else fitted.uncertainty(held_out).total
    streamed = _stream_dataset(dataset, fitted, report)
    scale = recipe.scale.fit(streamed.uncertainty, held_out_labeled_uncertainty=residuals)
    model = LeverageModel(fitted, scale)
    return _commit(dataset, recipe, model, streamed, name=run, seed=seed, started_at=started_at)


@overload
def rescore(
    dataset: Dataset,
    source: Dataset,
    source_run: str,
    *,
    run: str | None = None,
    progress: Progress | None = None,
) -> Run: ...
@overload
def rescore(
    dataset: Served,
    source: Served,
    source_run: str,
    *,
    run: str | None = None,
    progress: Progress | None = None,
) -> Run: ...
def rescore(
    dataset: Any,
    source: Any,
    source_run: str,
    *,
    run: str | None = None,
    progress: Progress | None = None,
) -> Run:
    """Give every pair of a dataset a leverage with what another run fitted.

    Leverages of the two runs are comparable: same estimator, same scale.

    Parameters
    ----------
    dataset
        The dataset to score, local or behind a service; it needs no labels.
    source
        The dataset of the other run: this one, another version of it, or another dataset with
        states and actions of the same widths; local like `dataset`, or behind the same service.
    source_run
        The other run's name.
    run
        Name of the new run; the estimator's kind, numbered, unless given.
    progress
        Called with what is being done, how much of it is done, and how much there is.

    Returns
    -------
    Run
        The record of the new run.

    Raises
    ------
    NotFoundError
        If `source` has no such run.
    InvalidInputError
        For other widths; nothing is written then.
    ConflictError
        If a run of the new name exists; nothing is written then.

    Examples
    --------
    >>> again = sd.rescore(dataset, dataset, "vae", run="again")
    >>> bool(np.array_equal(dataset.leverage("again"), dataset.leverage("vae")))
    True
    """
    if not isinstance(dataset, Dataset):
        return dataset.rescore(source, source_run, run=run, progress=progress)
    if not isinstance(source, Dataset):
        raise InvalidInputError(
            f"source: {source!r} is behind a service; open its store to score a local dataset"
        )
    started_at = time.perf_counter()
    original = source.runs.of_any_version(source_run)
    model = LeverageModel.from_archive(source.runs.model(original), original.fitted_scale)
    if run is not None:
        dataset.runs.check_unused(run)
    streamed = _stream_dataset(dataset, model.estimator, progress or _ignore_progress)
    return _commit(
        dataset,
        Recipe.of_run(original),
        model,
        streamed,
        name=run,
        seed=original.seed,
        started_at=started_at,
    )


def _read_labeled(dataset: Dataset, scale: Scale, seed: int) -> tuple[Pairs, Pairs | None]:
    """Read the labeled pairs to fit on and, for a conformal scale, those to calibrate on."""
    labeled = dataset.labeled()
    if isinstance(scale, Conformal):
        return split_held_out(labeled, share=scale.held_out, seed=seed)
    return labeled, None


def _stream_dataset(dataset: Dataset, fitted: Fitted, report: Progress) -> Streamed:
    """Give every pair of a dataset its uncertainty."""
    count = len(dataset)
    return stream(
        dataset.batches(), fitted, count=count, progress=lambda done: report("score", done, count)
    )


def _commit(
    dataset: Dataset,
    recipe: Recipe,
    model: LeverageModel,
    streamed: Streamed,
    *,
    name: str | None,
    seed: int,
    started_at: float,
) -> Run:
    """Write a run under a name, or under the first free one of its estimator's kind."""
    leverage = model.scale(streamed.uncertainty)
    if recipe.labeled_is_one:
        leverage[dataset.per_pair("labeled").astype(bool)] = 1.0
    standardizer = Standardizer.of_moments(streamed.mean, streamed.variance)
    archive = dump(model.estimator)
    record = Run(
        name=name or dataset.runs.free_name(recipe.estimator.kind),
        dataset=dataset.name,
        dataset_version=dataset.version,
        **recipe.to_json(),
        preset=recipe.preset,
        fitted_scale=scales.to_json(model.scale),
        seed=seed,
        pairs=len(dataset),
        labeled=int(dataset.per_pair("labeled").sum()),
        alpha=auto_alpha(standardizer(streamed.sample)),
        shift=standardizer.shift.tolist(),
        spread=standardizer.scale.tolist(),
        created=datetime.now(UTC).isoformat(),
        seconds=round(time.perf_counter() - started_at, 3),
        ssil_data=version("ssil-data"),
        model=digest(archive),
    )
    while True:
        try:
            dataset.runs.commit(record, archive, _value_chunks(dataset, streamed, leverage))
            return record
        except ConflictError:
            if name is not None:
                raise
        # another run took the free name meanwhile
        record = replace(record, name=dataset.runs.free_name(recipe.estimator.kind))


def _value_chunks(
    dataset: Dataset, streamed: Streamed, leverage: NDArray[np.float32]
) -> Iterator[pa.Table]:
    """Give the rows of the leverage table, a batch of the dataset's index at a time."""
    done = 0
    for index in dataset.index():
        rows = slice(done, done + len(index))
        done = rows.stop
        missing = pa.nulls(len(index), pa.float32())
        parts = {
            part: streamed.parts[part][rows] if part in streamed.parts else missing
            for part in PARTS
        }
        yield pa.table(
            {
                "episode": index.column("episode"),
                "step": index.column("step"),
                "uncertainty": streamed.uncertainty[rows],
                **parts,
                "leverage": leverage[rows],
            }
        )


def _ignore_progress(what: str, done: int, of: int) -> None:
    """Report nothing."""
