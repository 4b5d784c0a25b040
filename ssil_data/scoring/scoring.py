"""One scoring run: fit on the labeled pairs, stream every pair through, scale, commit."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data import scales
from ssil_data.demonstrations import Pairs
from ssil_data.errors import ConflictError, InvalidInputError
from ssil_data.estimators import ESTIMATORS, MDN, Estimator, Fitted, dump, from_json, load, to_json
from ssil_data.features import Standardizer
from ssil_data.field import auto_alpha
from ssil_data.scales import Conformal, FittedScale, MinMax, Quantile, Scale
from ssil_data.scoring.streaming import Streamed, stream
from ssil_data.store.arrow_schema import PARTS
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run
from ssil_data.store.runs import digest

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""

PRESETS = ("default", "paper")


@dataclass(frozen=True)
class Recipe:
    """How a run is made: the estimator, the scale, and whether labeled pairs get leverage 1."""

    estimator: Estimator
    scale: Scale
    labeled_is_one: bool = False

    def with_options(self, *, scale: str | None, surprisal: bool | None) -> Recipe:
        """Return the recipe with another scale, or with surprisal on or off, where given."""
        estimator = self.estimator
        if surprisal is not None:
            if not hasattr(estimator, "surprisal"):
                raise InvalidInputError(
                    f"surprisal: expected the estimator mdn or gpr, found {estimator.kind}"
                )
            estimator = replace(estimator, surprisal=surprisal)
        chosen = self.scale if scale is None else scales.SCALES[scale]()
        return replace(self, estimator=estimator, scale=chosen)


def preset(name: str, kind: str) -> Recipe:
    """Return the recipe of `paper` or `default` for an estimator kind; raises InvalidInputError.

    paper: min–max scale (Algorithm 1), labeled pairs get leverage 1, no surprisal.
    default: the best one measured (the README has the figures). An MDN's variances are no guide
    to quality on any data tried here, so it judges by surprisal; a GPR orders the tiers by its
    deviation and not by surprisal, though both tell experts apart.
    """
    if kind not in ESTIMATORS:
        raise InvalidInputError(f"estimator: expected one of {sorted(ESTIMATORS)}, found {kind!r}")
    plain = ESTIMATORS[kind]()
    recipes = {
        "paper": Recipe(plain, MinMax(), labeled_is_one=True),
        "default": Recipe(MDN(surprisal=True) if kind == MDN.kind else plain, Quantile()),
    }
    if name not in recipes:
        raise InvalidInputError(f"preset: expected one of {sorted(recipes)}, found {name!r}")
    return recipes[name]


@dataclass(frozen=True, eq=False)
class Scored:
    """What a model says of n pairs: uncertainty (n,), its parts, leverage (n,) in [0, 1]."""

    uncertainty: NDArray[np.float32]
    parts: Mapping[str, NDArray[np.float32]]
    leverage: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class LeverageModel:
    """A fitted estimator with its fitted scale: the leverage of pairs, seen before or not."""

    estimator: Fitted
    scale: FittedScale

    @classmethod
    def of(cls, dataset: Dataset, run: str) -> LeverageModel:
        """Load the model of a run of any version; raises NotFoundError or DamagedError."""
        return cls.of_record(dataset, dataset.runs.of_any_version(run))

    @classmethod
    def of_record(cls, dataset: Dataset, record: Run) -> LeverageModel:
        """Load the model of an opened run of a dataset; raises DamagedError."""
        return cls(load(dataset.runs.model(record)), scales.from_json(record.fitted_scale))

    def __call__(self, pairs: Pairs) -> Scored:
        """Score pairs; windows need the neighbouring rows of an episode in the same batch."""
        uncertainty = self.estimator.uncertainty(pairs)
        return Scored(uncertainty.total, uncertainty.parts, self.scale(uncertainty.total))


def score(
    dataset: Dataset,
    estimator: Estimator,
    *,
    scale: Scale | None = None,
    labeled_is_one: bool = False,
    seed: int = 0,
    run: str | None = None,
    progress: Progress | None = None,
) -> Run:
    """Fit an estimator on the labeled pairs, score every pair, commit one run and return it.

    `scale` is Quantile() unless given; `run` is named after the estimator unless given. Memory:
    some 40 bytes a pair beside a row group, however wide a state is. Same seed, same machine, same
    bytes. Raises InvalidInputError without labeled pairs, ConflictError if the run exists; nothing
    is written then.
    """
    begin = time.perf_counter()
    scale = Quantile() if scale is None else scale
    if run is not None:
        dataset.runs.check_unused(run)
    report = progress or _no_progress
    labeled, held_out = dataset.labeled(), None
    if isinstance(scale, Conformal):
        labeled, held_out = split_held_out(labeled, share=scale.held_out, seed=seed)
    report("fit", 0, 1)
    fitted = estimator.fit(labeled, seed=seed)
    report("fit", 1, 1)
    residuals = None if held_out is None else fitted.uncertainty(held_out).total
    recipe = Recipe(estimator, scale, labeled_is_one)
    job = _Job(dataset, recipe, fitted, run, seed, begin, report)
    return job.commit(partial(scale.fit, held_out_labeled_uncertainty=residuals))


def rescore(
    dataset: Dataset,
    source: Dataset,
    source_run: str,
    *,
    run: str | None = None,
    progress: Progress | None = None,
) -> Run:
    """Score every pair with the estimator and the scale that another run fitted.

    The other run may be another dataset's or another version's of the same widths.
    """
    begin = time.perf_counter()
    record = source.runs.of_any_version(source_run)
    model = LeverageModel.of_record(source, record)
    if run is not None:
        dataset.runs.check_unused(run)
    estimator, scale = from_json(record.estimator), scales.settings_from_json(record.scale)
    recipe = Recipe(estimator, scale, record.labeled_is_one)
    job = _Job(dataset, recipe, model.estimator, run, record.seed, begin, progress or _no_progress)
    return job.commit(lambda uncertainty: model.scale)


def split_held_out(labeled: Pairs, *, share: float, seed: int) -> tuple[Pairs, Pairs]:
    """Split labeled pairs into those to fit on and about `share` of them to calibrate on.

    Whole episodes are held out, chosen by the seed; of a single episode, its end. Neighbouring
    pairs are too alike for a split of pairs to measure anything.
    """
    episodes = np.unique(labeled.episode)
    if len(episodes) == 1:
        cut = len(labeled) - max(1, round(share * len(labeled)))
        return labeled[:cut], labeled[cut:]
    order = np.random.default_rng(seed).permutation(episodes)
    lengths = np.array([(labeled.episode == episode).sum() for episode in order])
    wanted = int(np.searchsorted(np.cumsum(lengths), share * len(labeled))) + 1
    chosen = np.isin(labeled.episode, order[: min(wanted, len(order) - 1)])
    return labeled.where(~chosen), labeled.where(chosen)


@dataclass(frozen=True, eq=False)
class _Job:
    """What a run is committed from, once its estimator is fitted."""

    dataset: Dataset
    recipe: Recipe
    fitted: Fitted
    name: str | None
    seed: int
    started_at: float
    report: Progress

    def commit(self, fit_scale: Callable[[NDArray[np.float32]], FittedScale]) -> Run:
        """Stream all pairs through the estimator, scale, and write the run."""
        count = len(self.dataset)
        streamed = stream(
            self.dataset.batches(),
            self.fitted,
            count=count,
            seen=lambda done: self.report("score", done, count),
        )
        scale = fit_scale(streamed.uncertainty)
        leverage = scale(streamed.uncertainty)
        if self.recipe.labeled_is_one:
            leverage[self.dataset.per_pair("labeled").astype(bool)] = 1.0
        model = dump(self.fitted)
        record = self._record(streamed, scale, digest(model))
        while True:
            try:
                self.dataset.runs.commit(record, model, self._values(streamed, leverage))
                return record
            except ConflictError:
                if self.name is not None:
                    raise
            record = replace(record, name=self._free_name())

    def _free_name(self) -> str:
        return self.name or self.dataset.runs.free_name(self.recipe.estimator.kind)

    def _record(self, streamed: Streamed, scale: FittedScale, model: str) -> Run:
        standardiser = Standardizer.of_moments(streamed.mean, streamed.variance)
        return Run(
            name=self._free_name(),
            dataset=self.dataset.name,
            dataset_version=self.dataset.version,
            estimator=to_json(self.recipe.estimator),
            preset=_preset_of(self.recipe),
            scale=scales.to_json(self.recipe.scale),
            fitted_scale=scales.to_json(scale),
            labeled_is_one=self.recipe.labeled_is_one,
            seed=self.seed,
            pairs=len(self.dataset),
            labeled=int(self.dataset.per_pair("labeled").sum()),
            alpha=auto_alpha(standardiser(streamed.sample)),
            shift=standardiser.shift.tolist(),
            spread=standardiser.scale.tolist(),
            created=datetime.now(UTC).isoformat(),
            seconds=round(time.perf_counter() - self.started_at, 3),
            ssil_data=version("ssil-data"),
            model=model,
        )

    def _values(self, streamed: Streamed, leverage: NDArray[np.float32]) -> Iterator[pa.Table]:
        done = 0
        for index in self.dataset.index():
            rows = slice(done, done + len(index))
            done = rows.stop
            yield pa.table(
                {
                    "episode": index.column("episode"),
                    "step": index.column("step"),
                    "uncertainty": streamed.uncertainty[rows],
                    **{
                        part: streamed.parts[part][rows]
                        if part in streamed.parts
                        else pa.nulls(len(index), pa.float32())
                        for part in PARTS
                    },
                    "leverage": leverage[rows],
                }
            )


def _preset_of(recipe: Recipe) -> str | None:
    kind = recipe.estimator.kind
    return next((name for name in PRESETS if preset(name, kind) == recipe), None)


def _no_progress(what: str, done: int, of: int) -> None:
    """Report to nobody."""
