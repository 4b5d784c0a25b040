"""The plan of a reproduction: its cells, and the scoring runs that they need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from ssil_data.scoring import preset as recipe_of
from ssil_data.store import Store
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.experiments.cells import (
    FIRST_TEST_SEED,
    Cell,
    Scoring,
    Task,
    Training,
    settings_of,
)
from ssil_trainers.experiments.fits import Fit, copy_dataset, limit_dataset
from ssil_trainers.experiments.provenance import code_digest, package_versions
from ssil_trainers.experiments.tables import (
    ESTIMATORS,
    LEVERAGE,
    LEVERAGE_PRESETS,
    Row,
    Table,
)


@dataclass(frozen=True)
class Plan:
    """What to run, in which store, and where results go.

    Parameters
    ----------
    tables:
        The tables of training runs.
    leverage:
        Dataset of the table of leverage by tier; None for no such table.
    seeds:
        Seeds of every cell.
    preset:
        Preset of the scoring runs that training uses.
    training:
        Settings of every training run.
    budget:
        Environment steps of each training run; None for the tables' own.
    source:
        The store of the demonstrations, which is only read.
    output:
        Folder of the results.
    work:
        Folder of the working stores.
    estimators:
        Rows of the table of leverage.
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
        """The work for all cells, seed by seed; makes the working copies that it needs."""
        training = [
            self._make_training_task(table, row, labels, seed)
            for seed in self.seeds
            for table in self.tables
            for row in table.rows
            for labels in (table.labels if row.labeled else (None,))
        ]
        return [*training, *self._make_scoring_tasks()]

    def settings(self, table: Table, seed: int) -> TrainSettings:
        """Return the settings of a table's training runs, the same for every method.

        Parameters
        ----------
        table:
            The table.
        seed:
            Seed of the runs.
        """
        return table.settings(self.training, seed=seed, budget=self.budget)

    def store(self, dataset: str) -> Store:
        """Return the working store of a dataset, and copy the dataset if that was not done.

        Parameters
        ----------
        dataset:
            Name of the dataset.
        """
        return copy_dataset(self.source, dataset, self.work)

    def _make_scoring_tasks(self) -> list[Task]:
        """List the work for the table of leverage."""
        if self.leverage is None:
            return []
        return [
            self._make_scoring_task(self.leverage, preset, estimator, seed)
            for seed in self.seeds
            for preset in LEVERAGE_PRESETS
            for estimator in self.estimators
        ]

    def _make_scoring_task(self, dataset: str, preset: str, estimator: str, seed: int) -> Task:
        """Return the work for one cell of leverage."""
        store = self.store(dataset)
        fit = Fit.of(store, dataset, estimator=estimator, preset=preset, seed=seed)
        cell = Cell(LEVERAGE, preset, estimator, None, seed)
        return Scoring(cell, self._identity(cell, dataset, fit, {}), self.output, fit)

    def _make_training_task(self, table: Table, row: Row, labels: int | None, seed: int) -> Task:
        """Return the work for one cell of a table of training runs."""
        store = self.store(table.dataset)
        settings = self.settings(table, seed)
        dataset = limit_dataset(store, table.dataset, labels)
        fit = None
        if row.estimator is not None:
            fit = Fit.of(store, dataset, estimator=row.estimator, preset=self.preset, seed=seed)
        cell = Cell(table.name, row.method, row.estimator, labels, seed)
        decisive = {
            "training": settings_of(row.method, settings),
            "trained_on": table.train_on,
            "tests": list(table.tests),
            "episodes": table.episodes,
            "first_test_seed": FIRST_TEST_SEED,
            "full_score": table.full_score,
        }
        return Training(
            cell=cell,
            identity=self._identity(cell, table.dataset, fit, decisive),
            output=self.output,
            fit=fit,
            table=table,
            settings=settings,
            store=store.folder.uri,
            dataset=dataset,
        )

    def _identity(
        self, cell: Cell, dataset: str, fit: Fit | None, decisive: dict[str, Any]
    ) -> dict[str, Any]:
        """Return everything that decides a result, in the form in which JSON returns it."""
        scoring = None
        if fit is not None:
            scoring = {
                "estimator": fit.estimator,
                "preset": fit.preset,
                "seed": fit.seed,
                "recipe": str(recipe_of(fit.preset, fit.estimator)),
            }
        return {
            "cell": {name: getattr(cell, name) for name in Cell.__dataclass_fields__},
            "dataset": dataset,
            "dataset_version": self.source[dataset].version,
            "scoring": scoring,
            **decisive,
            "versions": package_versions(),
            "code": code_digest(),
        }


def find_missing_fits(tasks: Sequence[Task]) -> list[Fit]:
    """List the scoring runs that tasks need and that do not exist, each once.

    Parameters
    ----------
    tasks:
        The work to be done.
    """
    found = dict.fromkeys(task.fit for task in tasks if task.fit is not None)
    return [fit for fit in found if not fit.is_made()]
