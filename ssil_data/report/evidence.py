"""What a report is about, read from the store once: runs, their leverage, groups of episodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data import pooling, scales
from ssil_data.errors import InvalidInputError
from ssil_data.quality import Quality, measure_quality
from ssil_data.scoring import Progress
from ssil_data.store.arrow_schema import FIRST_PARTS
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run


@dataclass(frozen=True, eq=False)
class ScoredRun:
    """A run with its values of all n pairs, each (n,).

    key names the run inside charts: r0, r1, … parts are the parts of the uncertainty by name, empty
    for estimators that have none. alone is the leverage that each pair would have if it were judged
    without its neighbors, None for a run that pools nothing.
    """

    key: str
    run: Run
    uncertainty: NDArray[np.float32]
    leverage: NDArray[np.float32]
    alone: NDArray[np.float32] | None
    parts: Mapping[str, NDArray[np.float32]]
    quality: Quality

    @property
    def name(self) -> str:
        """The run's name."""
        return self.run.name


@dataclass(frozen=True, eq=False)
class Evidence:
    """A dataset's runs, oldest first, and its e episodes in groups.

    chosen is the run with the best AUROC, or the oldest where none is known. groups are the names
    of the tiers of the unlabeled episodes, worst first, then "labeled"; group (e,) is the index in
    it of each episode. lengths (e,) are in steps, labeled (e,) is true for labeled episodes.
    """

    dataset: Dataset
    runs: list[ScoredRun]
    chosen: ScoredRun
    groups: list[str]
    group: NDArray[np.int64]
    lengths: NDArray[np.int64]
    labeled: NDArray[np.bool_]

    @classmethod
    def of(cls, dataset: Dataset, progress: Progress) -> Evidence:
        """Read all runs of the current version of a dataset.

        Parameters
        ----------
        dataset
            The dataset.
        progress
            Called after each run.

        Raises
        ------
        InvalidInputError
            If there is no run.
        """
        records = list(dataset.runs)
        if not records:
            raise InvalidInputError(
                f"runs of {dataset.name}: version {dataset.version} has none; "
                f"score it first: ssil-data score {dataset.name}"
            )
        runs = []
        for number, record in enumerate(records):
            progress("read", number, len(records))
            runs.append(_read_scored(dataset, f"r{number}", record))
        progress("read", len(records), len(records))
        groups, group = _group_episodes(
            dataset.episodes, list(runs[0].quality.mean_leverage_by_tier)
        )
        return cls(
            dataset=dataset,
            runs=runs,
            chosen=max(runs, key=lambda run: run.quality.auroc or 0.0),
            groups=groups,
            group=group,
            lengths=dataset.episodes["length"].to_numpy(),
            labeled=np.asarray(dataset.episodes["labeled"].to_pylist(), bool),
        )

    @property
    def names(self) -> dict[str, str]:
        """The names of the runs, by key."""
        return {run.key: run.name for run in self.runs}

    def per_pair(self, values: NDArray) -> NDArray:
        """Repeat a value of each episode for all of its pairs.

        Parameters
        ----------
        values
            Values (e,).

        Returns
        -------
        NDArray
            (n,).
        """
        return np.repeat(values, self.lengths)

    @property
    def leverage(self) -> dict[str, NDArray[np.float32]]:
        """The leverage of all pairs (n,) under each run, by key."""
        return {run.key: run.leverage for run in self.runs}

    @property
    def alone(self) -> dict[str, NDArray[np.float32]]:
        """The leverage of all pairs (n,), each judged alone, under each run that pools, by key."""
        return {run.key: run.alone for run in self.runs if run.alone is not None}


def _read_scored(dataset: Dataset, key: str, record: Run) -> ScoredRun:
    values = dataset.runs.values(record.name)
    leverage = values["leverage"].to_numpy()
    uncertainty = values["uncertainty"].to_numpy()
    return ScoredRun(
        key=key,
        run=record,
        uncertainty=uncertainty,
        leverage=leverage,
        alone=None if values["pooled"].null_count else _judge_alone(record, uncertainty),
        parts={
            part: values[part].to_numpy() for part in FIRST_PARTS if not values[part].null_count
        },
        quality=measure_quality(dataset, leverage),
    )


def _judge_alone(record: Run, uncertainty: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the leverage of pairs, each an episode of its own."""
    pools = pooling.from_json(record.fitted_pooling)
    pooled = pools(uncertainty, np.arange(len(uncertainty)))
    return scales.from_json(record.fitted_scale)(pooled)


def _group_episodes(episodes: pa.Table, tiers: list[str]) -> tuple[list[str], NDArray[np.int64]]:
    """Return the names of the groups, and the group of each episode."""
    labeled = episodes["labeled"].to_pylist()
    tier = episodes["tier"].to_pylist()
    unknown = "no tier" if tiers else "unlabeled"
    group = [
        "labeled" if known else unknown if name is None else name
        for known, name in zip(labeled, tier, strict=True)
    ]
    names = [name for name in dict.fromkeys([*tiers, unknown, "labeled"]) if name in group]
    return names, np.array([names.index(name) for name in group])
