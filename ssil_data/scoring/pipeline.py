"""From a recipe to a run: fit on the labeled pairs, stream every pair through, scale, commit."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any, Protocol, Self, TypeVar, overload

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data import pooling, scales
from ssil_data.demonstrations import Pairs
from ssil_data.errors import ConflictError, InvalidInputError
from ssil_data.estimators import Estimator, Fitted, dump, sample_unlabeled
from ssil_data.estimators.label_split import split_held_out
from ssil_data.features import Standardizer
from ssil_data.field import auto_alpha
from ssil_data.leverage_model import LeverageModel
from ssil_data.pooling.single import FittedSingle
from ssil_data.scales import Conformal, Scale
from ssil_data.scoring.cross_fit import rank_labeled
from ssil_data.scoring.health import Health, examine
from ssil_data.scoring.laps import count_laps
from ssil_data.scoring.poor_labels import ONE_EPISODE
from ssil_data.scoring.recipes import Recipe, preset
from ssil_data.scoring.self_training import choose_purest, collect_pairs, join_labeled
from ssil_data.scoring.streaming import Streamed, stream
from ssil_data.store.arrow_schema import PARTS, VALUES
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
        labels: int | None = None,
        seed: int = 0,
        run: str | None = None,
        progress: Progress | None = None,
    ) -> Run:
        """Do what `score` does, where the dataset is.

        Parameters
        ----------
        recipe, labels, seed, run, progress
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
    recipe: Recipe | Estimator | None = None,
    *,
    labels: int | None = None,
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
    if not isinstance(dataset, Dataset):
        chosen = preset("default") if recipe is None else recipe
        return dataset.score(chosen, labels=labels, seed=seed, run=run, progress=progress)
    started_at = time.perf_counter()
    recipe = preset("default") if recipe is None else Recipe.of(recipe)
    report = progress or _ignore_progress
    if run is not None:
        dataset.runs.check_unused(run)
    labeled = take_labels(dataset.labeled(), labels)
    made = _score_once(dataset, recipe, labeled, count=len(labeled), seed=seed, report=report)
    if recipe.self_training and (chosen := _choose_purest(dataset, made)) is not None:
        more = collect_pairs(dataset.batches(), chosen)
        both = join_labeled(labeled, more)
        again = _score_once(dataset, recipe, both, count=len(labeled), seed=seed, report=report)
        made = replace(again, self_trained=len(more))
    return _commit(dataset, recipe, made, name=run, seed=seed, started_at=started_at)


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
    model = LeverageModel.from_archive(
        source.runs.model(original), original.fitted_scale, original.fitted_pooling
    )
    if run is not None:
        dataset.runs.check_unused(run)
    recipe = Recipe.of_run(original)
    streamed = _stream_dataset(dataset, model.estimator, progress or _ignore_progress)
    labeled = dataset.per_pair("labeled").astype(bool)
    pooled = model.pooling(streamed.uncertainty, dataset.per_pair("episode"))
    leverage = _scale_all(model, pooled, labeled, labeled_is_one=recipe.labeled_is_one)
    health = None
    if labeled.any():
        health = examine(
            leverage[~labeled],
            model.scale,
            labeled=dataset.labeled(),
            held_out=None,
            unlabeled=None,
            rescored=True,
        )
    made = _Made(model, streamed, pooled, leverage, health, known=labeled)
    return _commit(dataset, recipe, made, name=run, seed=original.seed, started_at=started_at)


@dataclass(frozen=True, eq=False)
class _Made:
    """What becomes a run: the model, what it gives every pair, and how good that can be.

    known marks the labeled pairs that the run rests on, (n,).
    """

    model: LeverageModel
    streamed: Streamed
    pooled: NDArray[np.float32]
    leverage: NDArray[np.float32]
    health: Health | None
    known: NDArray[np.bool_]
    self_trained: int = 0


def take_labels(labeled: Pairs, count: int | None) -> Pairs:
    """Return the first labeled pairs.

    Parameters
    ----------
    labeled
        All labeled pairs, (m,).
    count
        How many to take; None for all.

    Raises
    ------
    InvalidInputError
        For fewer than two, or more than there are.
    """
    if count is None:
        return labeled
    check_label_count(count, len(labeled))
    return labeled[:count]


def check_label_count(count: int, labeled: int) -> None:
    """Refuse a number of labels that no run can rest on.

    Parameters
    ----------
    count
        How many labeled pairs are to be taken.
    labeled
        How many there are.

    Raises
    ------
    InvalidInputError
        For fewer than two, or more than there are.
    """
    whole = isinstance(count, int) and not isinstance(count, bool)
    if not whole or not 2 <= count <= labeled:
        raise InvalidInputError(
            f"labels: expected a whole number from 2 to {labeled}, the labeled pairs, "
            f"found {count!r}"
        )


def _score_once(
    dataset: Dataset, recipe: Recipe, labeled: Pairs, *, count: int, seed: int, report: Progress
) -> _Made:
    """Fit on labeled pairs, stream all pairs through, pool, scale, and examine the result.

    The first `count` labeled pairs of the dataset are known; of the others nothing is.
    """
    is_labeled = dataset.per_pair("labeled").astype(bool)
    check_unlabeled(recipe, is_labeled)
    known = is_labeled & (np.cumsum(is_labeled) <= count)
    unlabeled = None
    if recipe.needs_sample:
        unlabeled = sample_unlabeled(dataset.batches(), is_labeled, scale_floor=recipe.scale_floor)
    kept, calibration = _split_labeled(labeled, recipe.scale, seed)
    report("fit", 0, 1)
    fitted = recipe.estimator.fit(kept, seed=seed, unlabeled=unlabeled)
    ranks = None
    if recipe.cross_fit and unlabeled is not None:
        ranks = rank_labeled(recipe.estimator, recipe.pooling, kept, unlabeled=unlabeled, seed=seed)
    report("fit", 1, 1)
    streamed = _stream_dataset(dataset, fitted, report)
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
    scale = recipe.scale.fit(
        pooled[pool] if recipe.scale.of_unlabeled else pooled[pool | known],
        held_out,
        stretch=pools.stretch,
    )
    model = LeverageModel(fitted, scale, pools)
    health = examine(
        scale(pooled[~is_labeled]),
        scale,
        labeled=kept,
        held_out=None if held_out is None else scale(held_out),
        unlabeled=unlabeled,
    )
    leverage = _scale_all(model, pooled, known, labeled_is_one=recipe.labeled_is_one)
    return _Made(model, streamed, pooled, leverage, health, known)


def _choose_purest(dataset: Dataset, made: _Made) -> NDArray[np.bool_] | None:
    """Choose the pairs that join the labeled ones, unless the run is weak."""
    if made.health is None or set(made.health.weak) - {ONE_EPISODE}:
        return None
    return choose_purest(made.leverage, dataset.per_pair("labeled").astype(bool))


def check_unlabeled(recipe: Recipe, labeled: NDArray[np.bool_]) -> None:
    """Refuse a recipe that compares the expert with unlabeled pairs where there are none.

    Parameters
    ----------
    recipe
        How the run is to be made.
    labeled
        Whether each pair, or each episode, is labeled, (n,).

    Raises
    ------
    InvalidInputError
        If all are labeled and the estimator or the scale needs unlabeled ones.
    """
    if not labeled.all():
        return
    if recipe.estimator.needs_unlabeled or recipe.scale.of_unlabeled:
        raise InvalidInputError(
            "score: every pair is labeled, so there is nothing to compare the expert with; import "
            "the demonstrations of unknown quality too, or choose an estimator and a scale that "
            "need none: --estimator windowvae --scale conformal"
        )


def _scale_all(
    model: LeverageModel,
    pooled: NDArray[np.float32],
    labeled: NDArray[np.bool_],
    *,
    labeled_is_one: bool,
) -> NDArray[np.float32]:
    """Give all pairs their leverage."""
    leverage = model.scale(pooled)
    if labeled_is_one:
        leverage[labeled] = 1.0
    return leverage


def _split_labeled(labeled: Pairs, scale: Scale, seed: int) -> tuple[Pairs, Pairs | None]:
    """Return the labeled pairs to fit on and, for a conformal scale, those to calibrate on."""
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
    made: _Made,
    *,
    name: str | None,
    seed: int,
    started_at: float,
) -> Run:
    """Write a run under a name, or under the first free one of its estimator's kind."""
    streamed = made.streamed
    standardizer = Standardizer.of_moments(streamed.mean, streamed.variance)
    archive = dump(made.model.estimator)
    episode = dataset.per_pair("episode")
    health = {} if made.health is None else asdict(made.health)
    if health:
        # those of the labeled pairs, not of what was held out of them or joined them
        health["labeled_episodes"] = len(np.unique(episode[made.known]))
    positions = dataset.read_recorded("position") if made.known.any() else None
    record = Run(
        name=name or dataset.runs.free_name(recipe.estimator.kind),
        dataset=dataset.name,
        dataset_version=dataset.version,
        **recipe.to_json(),
        preset=recipe.preset,
        fitted_scale=scales.to_json(made.model.scale),
        fitted_pooling=pooling.to_json(made.model.pooling),
        seed=seed,
        pairs=len(dataset),
        labeled=int(made.known.sum()),
        laps=count_laps(positions, episode, made.known),
        self_trained=made.self_trained,
        **health,
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
            dataset.runs.commit(record, archive, _value_chunks(dataset, made))
            return record
        except ConflictError:
            if name is not None:
                raise
        # another run took the free name meanwhile
        record = replace(record, name=dataset.runs.free_name(recipe.estimator.kind))


def _value_chunks(dataset: Dataset, made: _Made) -> Iterator[pa.Table]:
    """Give the rows of the leverage table, a batch of the dataset's index at a time."""
    is_pooled = not isinstance(made.model.pooling, FittedSingle)
    done = 0
    for index in dataset.index():
        rows = slice(done, done + len(index))
        done = rows.stop
        missing = pa.nulls(len(index), pa.float32())
        known = made.streamed.parts
        parts = {part: known[part][rows] if part in known else missing for part in PARTS}
        values = pa.table(
            {
                "episode": index.column("episode"),
                "step": index.column("step"),
                "uncertainty": made.streamed.uncertainty[rows],
                **parts,
                "leverage": made.leverage[rows],
                "pooled": made.pooled[rows] if is_pooled else missing,
            }
        )
        yield values.select(VALUES.names)


def _ignore_progress(what: str, done: int, of: int) -> None:
    """Report nothing."""
