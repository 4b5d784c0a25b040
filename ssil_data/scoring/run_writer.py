"""What becomes a run, and writing it: the record, the model and the values in one commit."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data import pooling, scales
from ssil_data.errors import ConflictError
from ssil_data.estimators import dump
from ssil_data.features import Standardizer
from ssil_data.field import auto_alpha
from ssil_data.leverage_model import LeverageModel
from ssil_data.pooling.single import FittedSingle
from ssil_data.scoring.health import Health
from ssil_data.scoring.laps import count_laps
from ssil_data.scoring.recipes import Recipe
from ssil_data.scoring.streaming import Streamed
from ssil_data.store.arrow_schema import PARTS, VALUES
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run
from ssil_data.store.runs import digest


@dataclass(frozen=True, eq=False)
class Made:
    """What becomes a run: the model, what it gives every pair, and how good that can be.

    known marks the labeled pairs that the run rests on, (n,); inherited are fields of the record
    that stay those of the run whose model it is.
    """

    model: LeverageModel
    streamed: Streamed
    pooled: NDArray[np.float32]
    leverage: NDArray[np.float32]
    health: Health | None
    known: NDArray[np.bool_]
    self_trained: int = 0
    inherited: Mapping[str, Any] = field(default_factory=dict)


def scale_all(
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


def write_run(
    dataset: Dataset,
    recipe: Recipe,
    made: Made,
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
    record = replace(record, **made.inherited)
    while True:
        try:
            dataset.runs.commit(record, archive, _value_chunks(dataset, made))
            return record
        except ConflictError:
            if name is not None:
                raise
        # another run took the free name meanwhile
        record = replace(record, name=dataset.runs.free_name(recipe.estimator.kind))


def _value_chunks(dataset: Dataset, made: Made) -> Iterator[pa.Table]:
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
