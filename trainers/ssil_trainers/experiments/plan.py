"""Which cells there are, the scoring runs they need, and what of it is still to be done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from ssil_data.scoring import preset as recipe_of
from ssil_data.store import Store
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.experiments.cells import (
    FIRST_TEST_SEED,
    Cell,
    Scoring,
    Task,
    Training,
    settings_of,
)
from ssil_trainers.experiments.identity import code, versions
from ssil_trainers.experiments.lessons import Fit, copy_dataset, dataset_with_labels
from ssil_trainers.experiments.protocol import (
    ESTIMATORS,
    LEVERAGE,
    LEVERAGE_PRESETS,
    SHARED_RUN,
    Row,
    Table,
)


@dataclass(frozen=True)
class Plan:
    """What is to be run, in which store, and where results go.

    leverage: the dataset of the table of leverage by tier, None for no such table, and `estimators`
    its rows. budget: steps of each training run instead of the tables' own.
    """

    tables: tuple[Table, ...]
    leverage: str | None
    seeds: tuple[int, ...]
    preset: str
    training: TrainSettings
    budget: int | None
    source: Store
    output: Path
    work: Path
    estimators: tuple[str, ...] = ESTIMATORS

    @cached_property
    def tasks(self) -> list[Task]:
        """All cells, a seed after another; makes the working copies that they need."""
        training = [
            self._training_tasks(table, row, labels, seed)
            for seed in self.seeds
            for table in self.tables
            for row in table.rows
            for labels in (table.labels if row.labeled else (None,))
        ]
        return [*training, *self._scorings()]

    def settings(self, table: Table, seed: int) -> TrainSettings:
        """Return the settings of a table's runs of that seed, whatever the method."""
        return table.settings(self.training, seed=seed, budget=self.budget)

    def store(self, dataset: str) -> Store:
        """Return the working store of a dataset."""
        return copy_dataset(self.source, dataset, self.work)

    def _scorings(self) -> list[Task]:
        if self.leverage is None:
            return []
        return [
            self._scoring_tasks(self.leverage, preset, estimator, seed)
            for seed in self.seeds
            for preset in LEVERAGE_PRESETS
            for estimator in self.estimators
        ]

    def _scoring_tasks(self, dataset: str, preset: str, estimator: str, seed: int) -> Task:
        fit = Fit.of(self.store(dataset).folder.uri, dataset, estimator, preset, seed)
        cell = Cell(LEVERAGE, preset, estimator, None, seed)
        return Scoring(cell, self._identity(cell, dataset, fit, {}), self.output, fit)

    def _training_tasks(self, table: Table, row: Row, labels: int | None, seed: int) -> Task:
        store, settings = self.store(table.dataset), self.settings(table, seed)
        dataset = dataset_with_labels(store, table.dataset, labels)
        fit = None
        if METHODS[row.method].takes_run:  # MixGAIL, too: one kernel for all
            estimator = row.estimator or SHARED_RUN
            fit = Fit.of(store.folder.uri, dataset, estimator, self.preset, seed)
        cell = Cell(table.name, row.method, row.estimator, labels, seed)
        decided = {
            "training": settings_of(row.method, settings),
            "trained_on": table.train_on,
            "tests": list(table.tests),
            "episodes": table.episodes,
            "first_test_seed": FIRST_TEST_SEED,
            "full_score": table.full_score,
        }
        identity = self._identity(cell, table.dataset, fit, decided)
        uri = store.folder.uri
        return Training(cell, identity, self.output, fit, table, settings, uri, dataset)

    def _identity(
        self, cell: Cell, dataset: str, fit: Fit | None, decided: dict[str, Any]
    ) -> dict[str, Any]:
        """Return all that decides a result, as JSON gives it back."""
        scoring = None
        if fit is not None:
            scoring = {"estimator": fit.estimator, "preset": fit.preset, "seed": fit.seed}
            scoring["recipe"] = str(recipe_of(fit.preset, fit.estimator))
        return {
            "cell": {name: getattr(cell, name) for name in Cell.__dataclass_fields__},
            "dataset": dataset,
            "dataset_version": self.source[dataset].version,
            "scoring": scoring,
            **decided,
            "versions": versions(),
            "code": code(),
        }


def fits_of(tasks: Sequence[Task]) -> list[Fit]:
    """Return the scoring runs that tasks need and nobody made, each once."""
    found = dict.fromkeys(task.fit for task in tasks if task.fit is not None)
    return [fit for fit in found if not fit.is_made()]
