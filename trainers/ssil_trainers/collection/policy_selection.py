"""Finding the drivers of a demonstration set: one expert, and mediocre ones for every tier."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from ssil_data.errors import NotFoundError
from ssil_data.scoring import Progress
from ssil_trainers.collection.ppo import Checkpoint, PPOSettings, train
from ssil_trainers.collection.quality_tiers import Band
from ssil_trainers.collection.recording import EvaluationCourse, RecordedEpisode

MakeEnv = Callable[[], gymnasium.Env[Any, Any]]


@dataclass(frozen=True)
class DriverTrainer:
    """Where drivers are trained and measured; PPO's seeds are derived from `seed`."""

    make_env: MakeEnv
    course: EvaluationCourse
    seed: int
    progress: Progress

    def train_expert(self, settings: PPOSettings, *, measure: int) -> Checkpoint:
        """Train one run; return its checkpoint of the highest mean return over `measure` drives."""
        checkpoints = self._train("expert", 0, settings)
        returns = [
            self.course.returns(checkpoint, measure).mean()
            for checkpoint in self._report_each("measure expert", checkpoints)
        ]
        return checkpoints[int(np.argmax(returns))]

    def train_under_trained(
        self, settings: PPOSettings, *, runs: int, measure: int, expert_return: float
    ) -> tuple[list[Checkpoint], list[np.ndarray]]:
        """Train several short runs; return all their checkpoints and each one's episode scores."""
        checkpoints = [
            checkpoint
            for run in range(1, runs + 1)
            for checkpoint in self._train(f"run {run}", run, settings)
        ]
        scores = [
            self.course.returns(checkpoint, measure) / expert_return
            for checkpoint in self._report_each("measure checkpoints", checkpoints)
        ]
        return checkpoints, scores

    def _train(self, name: str, run: int, settings: PPOSettings) -> list[Checkpoint]:
        seed = int(np.random.SeedSequence([self.seed, run]).generate_state(1)[0])

        def progress(steps: int) -> None:
            self.progress(f"train {name}", min(steps, settings.steps), settings.steps)

        checkpoints = train(self.make_env, settings, run=name, seed=seed, progress=progress)
        progress(settings.steps)
        return checkpoints

    def _report_each(self, what: str, checkpoints: Sequence[Checkpoint]) -> Iterator[Checkpoint]:
        for done, checkpoint in enumerate(checkpoints):
            yield checkpoint
            self.progress(what, done + 1, len(checkpoints))


def drives_within(
    band: Band,
    drivers: Sequence[Checkpoint],
    course: EvaluationCourse,
    *,
    expert_return: float,
    patience: int,
) -> Iterator[RecordedEpisode]:
    """Yield drives that score inside the band; who has driven least so far drives next.

    Raises NotFoundError when `patience` steps were driven since the last such drive.
    """
    driven = [0] * len(drivers)
    since = 0
    while since <= patience:
        turn = int(np.argmin(driven))
        drive = course.drive(drivers[turn])
        driven[turn] += len(drive)
        since += len(drive)
        if drive.total / expert_return in band:
            yield drive
            since = 0
    names = ", ".join(map(str, drivers))
    raise NotFoundError(
        f"tier {band.tier}: expected a drive that scores from {band.low:.2f} to {band.high:.2f} "
        f"within {patience} steps of [{names}], found none"
    )
