"""Table cells: one training run or scoring run each, and the file that keeps its result."""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ssil_data.errors import InvalidInputError
from ssil_data.quality import measure_quality
from ssil_data.scoring.laps import count_laps
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_data.store.folder import Folder
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.algorithms.policy import Policy
from ssil_trainers.envs.registry import make_single, make_vectorized
from ssil_trainers.experiments.fits import Fit
from ssil_trainers.experiments.tables import Table
from ssil_trainers.training.data import TrainingData
from ssil_trainers.training.evaluation import drive_episode
from ssil_trainers.training.run import train

FIRST_TEST_SEED = 10_000
"""Seed of the first test episode; the next ones have the following seeds, for every policy."""


@dataclass(frozen=True)
class Cell:
    """Which number of which table.

    Parameters
    ----------
    table:
        Name of the table.
    method:
        The method; in the table of leverage, the preset.
    estimator:
        Estimator of the leverage; None for a method without one.
    labels:
        Number of labeled pairs; None for all.
    seed:
        Seed of the run.
    """

    table: str
    method: str
    estimator: str | None
    labels: int | None
    seed: int

    @property
    def name(self) -> str:
        """The name of its file, without suffix."""
        labels = None if self.labels is None else f"{self.labels}-labels"
        parts = (self.table, self.method, self.estimator, labels, f"seed-{self.seed}")
        return "-".join(part for part in parts if part is not None)


@dataclass(frozen=True)
class Task(ABC):
    """The work that fills a cell.

    Parameters
    ----------
    cell:
        The cell.
    identity:
        Everything that decides the result, as JSON: a result with another identity is outdated.
    output:
        Folder of the reproduction.
    fit:
        The scoring run it needs; None for none.
    """

    cell: Cell
    identity: Mapping[str, Any]
    output: Path
    fit: Fit | None

    @property
    def name(self) -> str:
        """The name in progress lines."""
        return self.cell.name

    @abstractmethod
    def __call__(self) -> None:
        """Do the work and write the result."""

    @property
    def path(self) -> Path:
        """The file of the result."""
        return self.output / "cells" / f"{self.cell.name}.json"

    def read_result(self) -> dict[str, Any] | None:
        """Read the result; None if there is none, or an outdated one."""
        if not self.path.exists():
            return None
        found = json.loads(self.path.read_text("utf-8"))
        return found if found["identity"] == self.identity else None

    def write_result(self, result: Mapping[str, Any]) -> None:
        """Write the result completely or not at all.

        Parameters
        ----------
        result:
            The figures, as JSON.
        """
        text = json.dumps({"identity": self.identity, **result}, indent=1, allow_nan=False)
        Folder(self.path.parent).write(self.path.name, f"{text}\n".encode())


@dataclass(frozen=True)
class Training(Task):
    """Trains in the vectorized twin, then tests the policy in the real environment.

    Parameters
    ----------
    table:
        The table, which says where to train and to test.
    settings:
        Settings of the training run.
    store:
        Location of the working store.
    dataset:
        Name of the demonstrations in it.
    """

    table: Table
    settings: TrainSettings
    store: str
    dataset: str

    def __call__(self) -> None:
        """Train, test, and write the result."""
        clock = Clock()
        dataset = Store(self.store)[self.dataset]
        data, full_score = self._read_data(dataset)
        trained = train(
            self.cell.method,
            data,
            lambda count: make_vectorized(self.table.train_on, count),
            settings=self.settings,
        )
        tests = {
            task: _test_policy(trained.policy, task, self.table.episodes)
            for task in self.table.tests
        }
        scores = {
            task: float(np.mean(found["returns"]) / full_score) for task, found in tests.items()
        }
        curve = [row.figures() for row in trained.curve if row.evaluation is not None]
        self.write_result(
            {
                "score": float(np.mean(list(scores.values()))),
                "full_score": full_score,
                "recorded_return": data.recorded_return,
                "laps": _count_laps(dataset),
                "scores": scores,
                "tests": tests,
                "curve": curve,
                **clock.spent(),
            }
        )

    def _read_data(self, dataset: Dataset) -> tuple[TrainingData, float]:
        """Read the demonstrations, and the return that counts as 1 in the table."""
        run = None if self.fit is None else self.fit.run
        data = TrainingData.read(dataset, run, threads=1)
        full_score = self.table.full_score or data.expert_return
        if full_score is None:
            raise InvalidInputError(
                f"{self.dataset}: no whole episode has rewards and a score, so the expert's return "
                "is not known"
            )
        return replace(data, expert_return=full_score), full_score


@dataclass(frozen=True)
class Scoring(Task):
    """Measures how good the leverage of a scoring run is; the run is made before."""

    def __call__(self) -> None:
        """Measure, and write the result."""
        assert self.fit is not None
        clock = Clock()
        dataset = Store(self.fit.store)[self.fit.dataset]
        found = asdict(measure_quality(dataset, dataset.leverage(self.fit.run)))
        self.write_result({**found, **clock.spent()})


class Clock:
    """Measures the time since it was made."""

    def __init__(self) -> None:
        self._wall = time.perf_counter()
        self._processor = time.process_time()

    def spent(self) -> dict[str, float]:
        """Return wall time and processor time in seconds, by their names in a result."""
        return {
            "seconds": round(time.perf_counter() - self._wall, 2),
            "processor_seconds": round(time.process_time() - self._processor, 2),
        }


def settings_of(method: str, settings: TrainSettings) -> dict[str, Any]:
    """Return the settings that a method is trained with, as JSON.

    Parameters
    ----------
    method:
        Name of the method.
    settings:
        Settings of the run.
    """
    return asdict(METHODS[method].override(settings))


def _count_laps(dataset: Dataset) -> float | None:
    """Return how many laps the labeled pairs cover; None where no lap is known."""
    labeled = dataset.per_pair("labeled").astype(bool)
    return count_laps(dataset.read_recorded("position"), dataset.pairs().episode, labeled)


def _test_policy(policy: Policy, task: str, episodes: int) -> dict[str, list[Any]]:
    """Run test episodes in the real environment; return their returns and lengths."""
    env = make_single(task)
    found = [
        drive_episode(policy, env, seed=FIRST_TEST_SEED + number) for number in range(episodes)
    ]
    env.close()
    returns, lengths = zip(*found, strict=True)
    return {"returns": list(returns), "lengths": list(lengths)}
