"""What a report is about, read from the store once: runs, leverage and groups of episodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.quality import Quality, measure_quality
from ssil_data.scoring import Progress
from ssil_data.store.arrow_schema import PARTS
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run


@dataclass(frozen=True, eq=False)
class Scored:
    """A run and what it said of all n pairs, each (n,); `key` names it inside charts."""

    key: str
    run: Run
    uncertainty: NDArray[np.float32]
    leverage: NDArray[np.float32]
    parts: Mapping[str, NDArray[np.float32]]
    quality: Quality

    @property
    def name(self) -> str:
        """The run's name."""
        return self.run.name


@dataclass(frozen=True, eq=False)
class Evidence:
    """A dataset's episodes in groups, and its runs, oldest first.

    `chosen` is the run of the best AUROC, or the first where none is known. Groups are the tiers of
    the unlabeled episodes, worst first, then the labeled episodes; group (e,) is the place in
    `groups` of each episode.
    """

    dataset: Dataset
    runs: list[Scored]
    chosen: Scored
    groups: list[str]
    group: NDArray[np.int64]
    lengths: NDArray[np.int64]
    labeled: NDArray[np.bool_]

    @classmethod
    def of(cls, dataset: Dataset, progress: Progress) -> Evidence:
        """Read every run of this version of a dataset; raises InvalidInputError without any."""
        records = list(dataset.runs)
        if not records:
            raise InvalidInputError(
                f"runs of {dataset.name}: expected at least one of version {dataset.version}, "
                f"found none; score it first: ssil-data score {dataset.name} --estimator windowvae"
            )
        runs = []
        for number, record in enumerate(records):
            progress("read", number, len(records))
            runs.append(_read_scored(dataset, f"r{number}", record))
        progress("read", len(records), len(records))
        groups, group = _groups(dataset.episodes, list(runs[0].quality.mean_leverage_by_tier))
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
        """The names of the runs by their keys."""
        return {run.key: run.name for run in self.runs}

    def per_pair(self, values: NDArray) -> NDArray:
        """Return a value of each episode (e,) for every pair (n,)."""
        return np.repeat(values, self.lengths)

    @property
    def leverage(self) -> dict[str, NDArray[np.float32]]:
        """The leverage of every pair (n,) by the key of the run."""
        return {run.key: run.leverage for run in self.runs}


def _read_scored(dataset: Dataset, key: str, record: Run) -> Scored:
    values = dataset.runs.values(record.name)
    leverage = values["leverage"].to_numpy()
    return Scored(
        key=key,
        run=record,
        uncertainty=values["uncertainty"].to_numpy(),
        leverage=leverage,
        parts={part: values[part].to_numpy() for part in PARTS if not values[part].null_count},
        quality=measure_quality(dataset, leverage),
    )


def _groups(episodes: pa.Table, tiers: list[str]) -> tuple[list[str], NDArray[np.int64]]:
    labeled, tier = episodes["labeled"].to_pylist(), episodes["tier"].to_pylist()
    unknown = "no tier" if tiers else "unlabeled"
    group = [
        "labeled" if known else unknown if name is None else name
        for known, name in zip(labeled, tier, strict=True)
    ]
    names = [name for name in dict.fromkeys([*tiers, unknown, "labeled"]) if name in group]
    return names, np.array([names.index(name) for name in group])
