"""A cell: one training run, or one scoring run, of a table, and the file that keeps its result."""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ssil_data.errors import InvalidInputError
from ssil_data.quality import quality
from ssil_data.store import Store
from ssil_data.store.folder import Folder
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.algorithms.policy import Policy
from ssil_trainers.commands.evaluate import drive
from ssil_trainers.envs.registry import make_single, make_vectorized
from ssil_trainers.experiments.lessons import Fit
from ssil_trainers.experiments.protocol import Table
from ssil_trainers.training.data_source import TrainingData
from ssil_trainers.training.run import TrainJob, train

FIRST_TEST_SEED = 10_000
"""Where an episode of a test starts: at this seed and those after it, for every policy."""


@dataclass(frozen=True)
class Cell:
    """Which number of which table; for leverage the method is the preset, labels None is all."""

    table: str
    method: str
    estimator: str | None
    labels: int | None
    seed: int

    @property
    def name(self) -> str:
        """The name of its file."""
        labels = None if self.labels is None else f"{self.labels}-labels"
        parts = (self.table, self.method, self.estimator, labels, f"seed-{self.seed}")
        return "-".join(part for part in parts if part is not None)


@dataclass(frozen=True)
class Task(ABC):
    """A cell with all that decides its result: `identity` is that as JSON."""

    cell: Cell
    identity: Mapping[str, Any]
    output: Path
    fit: Fit | None

    @property
    def name(self) -> str:
        """What a progress line calls it."""
        return self.cell.name

    @abstractmethod
    def __call__(self) -> None:
        """Do it and keep the result."""

    @property
    def path(self) -> Path:
        """The file of the result."""
        return self.output / "cells" / f"{self.cell.name}.json"

    def result(self) -> dict[str, Any] | None:
        """Read the result; None if there is none, or one that something else was decided by."""
        if not self.path.exists():
            return None
        found = json.loads(self.path.read_text("utf-8"))
        return found if found["identity"] == self.identity else None

    def keep(self, result: Mapping[str, Any]) -> None:
        """Write the result whole or not at all."""
        text = json.dumps({"identity": self.identity, **result}, indent=1, allow_nan=False)
        Folder(self.path.parent).write(self.path.name, f"{text}\n".encode())


@dataclass(frozen=True)
class Training(Task):
    """Trains on the twin, then drives the real environment by the policy's mean action."""

    table: Table
    settings: TrainSettings
    store: str
    dataset: str

    def __call__(self) -> None:
        """Do it and keep the result."""
        wall, processor = time.perf_counter(), time.process_time()
        table, method = self.table, self.cell.method
        run = None if self.fit is None else self.fit.run
        lessons = TrainingData.of(Store(self.store)[self.dataset], run, threads=1)
        full = table.full_score or lessons.expert_return
        if full is None:
            raise InvalidInputError(f"{self.dataset}: expected scored episodes with rewards")
        job = TrainJob(
            method,
            self.settings,
            lessons.demonstrations,
            lambda count: make_vectorized(table.train_on, count),
            origin={},
            expert_return=full,
        )
        trained = train(job)
        rows = [moment.row() for moment in trained.curve if moment.evaluation is not None]
        tests = {test: _evaluate(trained.policy, test, table.episodes) for test in table.tests}
        scores = {test: float(np.mean(found["returns"]) / full) for test, found in tests.items()}
        self.keep(
            {
                "score": float(np.mean(list(scores.values()))),
                "full_score": full,
                "scores": scores,
                "tests": tests,
                "curve": rows,
                "seconds": round(time.perf_counter() - wall, 2),
                "processor_seconds": round(time.process_time() - processor, 2),
            }
        )


@dataclass(frozen=True)
class Scoring(Task):
    """Judges the leverage of a scoring run that was made before."""

    def __call__(self) -> None:
        """Do it and keep the result."""
        assert self.fit is not None
        wall, processor = time.perf_counter(), time.process_time()
        dataset = Store(self.fit.store)[self.fit.dataset]
        found = asdict(quality(dataset, dataset.leverage(self.fit.run)))
        seconds = round(time.perf_counter() - wall, 2)
        spent = round(time.process_time() - processor, 2)
        self.keep({**found, "seconds": seconds, "processor_seconds": spent})


def settings_of(method: str, given: TrainSettings) -> dict[str, Any]:
    """Return the settings that a method trains by, as JSON."""
    return asdict(METHODS[method].settings(given))


def _evaluate(policy: Policy, task: str, episodes: int) -> dict[str, list[Any]]:
    """Drive so many episodes of the real environment."""
    world = make_single(task)
    driven = [drive(policy, world, seed=FIRST_TEST_SEED + number) for number in range(episodes)]
    world.close()
    returns, lengths = zip(*driven, strict=True)
    return {"returns": list(returns), "lengths": list(lengths)}
