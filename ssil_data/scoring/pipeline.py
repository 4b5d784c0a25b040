"""From a recipe to a run: fit on the labeled pairs, stream every pair through, scale, commit."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.estimators import Estimator, sample_unlabeled
from ssil_data.estimators.label_split import split_held_out
from ssil_data.json_kinds import to_python_number
from ssil_data.leverage_model import LeverageModel
from ssil_data.scales import Conformal, Scale
from ssil_data.scoring.cross_fit import rank_labeled
from ssil_data.scoring.health import examine
from ssil_data.scoring.labels import check_unlabeled, take_labels
from ssil_data.scoring.poor_labels import ONE_EPISODE
from ssil_data.scoring.recipes import Recipe, preset
from ssil_data.scoring.run_writer import Made, scale_all, write_run
from ssil_data.scoring.self_training import choose_purest, collect_pairs, join_labeled
from ssil_data.scoring.served import Progress, ServedDataset, ignore_progress
from ssil_data.scoring.stated_share import find_misfit
from ssil_data.scoring.streaming import stream_dataset
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run


def score(
    dataset: Dataset | ServedDataset,
    recipe: Recipe | Estimator | None = None,
    *,
    labels: int | None = None,
    seed: int = 0,
    run: str | None = None,
    progress: Progress | None = None,
) -> Run:
    """Give every pair of a dataset a leverage in [0, 1] and commit it as one run.

    The estimator is fitted on the labeled pairs. Memory: some 250 bytes a pair beside a row group,
    however wide a state is.

    Parameters
    ----------
    dataset
        The dataset, local or behind a service; its labeled episodes are the expert's.
    recipe
        How: a recipe, or an estimator, which then goes with the quantile scale and nothing pooled.
        Without one, the preset `default`: what measured best.
    labels
        Fit on only so many labeled pairs, the first ones, to see what fewer labels would give. The
        other labeled pairs get a leverage, but nothing is learned from them: they are no part of
        the unlabeled pairs either. None for all.
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
        Without labeled pairs, for fewer than two `labels` or more than there are, or without
        unlabeled pairs where the recipe needs them; nothing is written then.
    ConflictError
        If a run of that name exists; nothing is written then.

    Examples
    --------
    >>> run = sd.score(dataset, sd.VAE(steps=20), seed=0, run="mine")
    >>> leverage = dataset.leverage(run.name)
    >>> leverage.shape == (len(dataset),), bool(leverage.min() >= 0), bool(leverage.max() <= 1)
    (True, True, True)
    """
    labels, seed = to_python_number(labels), to_python_number(seed)
    if not isinstance(dataset, Dataset):
        chosen = preset("default") if recipe is None else recipe
        return dataset.score(chosen, labels=labels, seed=seed, run=run, progress=progress)
    started_at = time.perf_counter()
    recipe = preset("default") if recipe is None else Recipe.of(recipe)
    report = progress or ignore_progress
    if run is not None:
        dataset.runs.check_unused(run)
    labeled = take_labels(dataset.labeled(), labels)
    made = _score_once(dataset, recipe, labeled, joined=None, seed=seed, report=report)
    if recipe.self_training and (chosen := _choose_purest(dataset, made)) is not None:
        more = collect_pairs(dataset.batches(), chosen)
        again = _score_once(dataset, recipe, labeled, joined=more, seed=seed, report=report)
        made = replace(again, self_trained=len(more))
    return write_run(dataset, recipe, made, name=run, seed=seed, started_at=started_at)


def _score_once(
    dataset: Dataset,
    recipe: Recipe,
    labeled: Pairs,
    *,
    joined: Pairs | None,
    seed: int,
    report: Progress,
) -> Made:
    """Fit on labeled pairs, stream all pairs through, pool, scale, and examine the result.

    `labeled` are the dataset's first labeled pairs; of its others nothing is known. `joined` pairs
    are fitted on like labeled ones, and what the run says of itself does not rest on them.
    """
    is_labeled = dataset.per_pair("labeled").astype(bool)
    check_unlabeled(recipe, is_labeled)
    known = is_labeled & (np.cumsum(is_labeled) <= len(labeled))
    unlabeled = None
    if recipe.needs_sample:
        unlabeled = sample_unlabeled(dataset.batches(), is_labeled, scale_floor=recipe.scale_floor)
    kept, calibration = _split_labeled(labeled, recipe.scale, seed)
    report("fit", 0, 1)
    fitted_on = kept if joined is None else join_labeled(kept, joined)
    fitted = recipe.estimator.fit(fitted_on, seed=seed, unlabeled=unlabeled)
    ranks = None
    if recipe.cross_fit and unlabeled is not None:
        ranks = rank_labeled(
            recipe.estimator,
            recipe.pooling,
            kept,
            unlabeled=unlabeled,
            seed=seed,
            joined=joined,
        )
    report("fit", 1, 1)
    streamed = stream_dataset(dataset, fitted, report)
    episode = dataset.per_pair("episode")
    # without unlabeled pairs, the labeled ones are all the pool there is
    pool = ~is_labeled if not is_labeled.all() else known
    pools = recipe.pooling.fit(streamed.uncertainty[pool], episode[pool])
    pooled = pools(streamed.uncertainty, episode)
    held_out = None
    if calibration is not None:
        held_out = pools(fitted.uncertainty(calibration).total, calibration.episode)
    elif ranks is not None:
        held_out = np.quantile(pooled[pool], ranks).astype(np.float32)
    rows = pool if recipe.scale.of_unlabeled else pool | known
    scale = recipe.scale.fit(pooled[rows], held_out, stretch=pools.stretch)
    model = LeverageModel(fitted, scale, pools)
    health = examine(
        scale(pooled[~is_labeled]),
        scale,
        labeled=labeled,
        held_out=None if held_out is None else scale(held_out),
        unlabeled=unlabeled,
        doubts=find_misfit(recipe.scale, pooled[rows], held_out, stretch=pools.stretch),
    )
    leverage = scale_all(model, pooled, known, labeled_is_one=recipe.labeled_is_one)
    return Made(model, streamed, pooled, leverage, health, known)


def _choose_purest(dataset: Dataset, made: Made) -> NDArray[np.bool_] | None:
    """Choose the pairs that join the labeled ones, unless the run is weak."""
    if made.health is None or set(made.health.weak) - {ONE_EPISODE}:
        return None
    return choose_purest(made.leverage, dataset.per_pair("labeled").astype(bool))


def _split_labeled(labeled: Pairs, scale: Scale, seed: int) -> tuple[Pairs, Pairs | None]:
    """Return the labeled pairs to fit on and, for a conformal scale, those to calibrate on."""
    if isinstance(scale, Conformal):
        return split_held_out(labeled, share=scale.held_out, seed=seed)
    return labeled, None
