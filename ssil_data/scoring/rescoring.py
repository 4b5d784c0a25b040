"""Scoring with what another run fitted: same estimator, same pooling, same scale."""

from __future__ import annotations

import time
from typing import Any, overload

import numpy as np

from ssil_data.errors import InvalidInputError
from ssil_data.leverage_model import LeverageModel
from ssil_data.scoring.health import examine
from ssil_data.scoring.recipes import Recipe
from ssil_data.scoring.run_writer import Made, scale_all, write_run
from ssil_data.scoring.served import Progress, Served, ignore_progress
from ssil_data.scoring.streaming import stream_dataset
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run

_INHERITED = (
    "labeled",
    "labeled_episodes",
    "laps",
    "self_trained",
    "held_out_auroc",
    "calibration_error",
)
"""What a record says of the fit, which is that of the run whose model is used."""


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

    Leverages of the two runs are comparable: same estimator, same scale. What the record says of
    the fit, such as its labels and why it is weak, is that of the other run.

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
    model = LeverageModel.from_archive(
        source.runs.model(original), original.fitted_scale, original.fitted_pooling
    )
    if run is not None:
        dataset.runs.check_unused(run)
    recipe = Recipe.of_run(original)
    streamed = stream_dataset(dataset, model.estimator, progress or ignore_progress)
    labeled = dataset.per_pair("labeled").astype(bool)
    pooled = model.pooling(streamed.uncertainty, dataset.per_pair("episode"))
    leverage = scale_all(model, pooled, labeled, labeled_is_one=recipe.labeled_is_one)
    health = examine(leverage[~labeled], model.scale, labeled=None, held_out=None, unlabeled=None)
    inherited = {name: getattr(original, name) for name in _INHERITED}
    inherited["weak"] = tuple(dict.fromkeys([*original.weak, *health.weak]))
    # it rests on no pair of this dataset
    known = np.zeros(len(labeled), dtype=bool)
    made = Made(model, streamed, pooled, leverage, health, known, inherited=inherited)
    return write_run(dataset, recipe, made, name=run, seed=original.seed, started_at=started_at)
