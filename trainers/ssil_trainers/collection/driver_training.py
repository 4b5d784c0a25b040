"""Training and measuring the policies that drive: one expert, and worse ones for every tier."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from ssil_data.scoring import Progress
from ssil_trainers.collection.ppo import Checkpoint, PPOSettings, train_ppo
from ssil_trainers.collection.recording import EvaluationCourse

MakeEnv = Callable[[], gymnasium.Env[Any, Any]]


@dataclass(frozen=True)
class DriverTrainer:
    """Trains drivers with PPO and measures them.

    Parameters
    ----------
    make_env:
        Makes an environment to train in; its own reward is maximized.
    course:
        Where checkpoints are measured.
    seed:
        PPO's seeds are derived from it.
    progress:
        Called with what is done, how much of it, and how much there is.

    Examples
    --------
    >>> from ssil_trainers.collection.driver_training import DriverTrainer
    >>> from ssil_trainers.collection.ppo import PPOSettings
    >>> from ssil_trainers.collection.recording import EvaluationCourse
    >>> from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
    >>> course = EvaluationCourse(RCLidarEnv("hall"))
    >>> trainer = DriverTrainer(lambda: RCLidarEnv("hall"), course, 0, lambda what, done, of: None)
    >>> settings = PPOSettings(64, learning_rate=3e-4, environments=2, rollout=32, batch=32)
    >>> checkpoints, scores = trainer.train_under_trained(
    ...     settings, runs=1, measure=2, expert_return=400.0
    ... )
    >>> [str(one) for one in checkpoints], scores[0].shape
    (['ppo run 1 checkpoint 0 steps', 'ppo run 1 checkpoint 64 steps'], (2,))
    """

    make_env: MakeEnv
    course: EvaluationCourse
    seed: int
    progress: Progress

    def train_expert(self, settings: PPOSettings, *, measure: int) -> Checkpoint:
        """Train one run; return its checkpoint with the highest mean return.

        Parameters
        ----------
        settings:
            How the run is trained.
        measure:
            Episodes that measure a checkpoint.
        """
        checkpoints = self._train("expert", 0, settings)
        returns = [
            self.course.measure_returns(checkpoint, measure).mean()
            for checkpoint in self._report_each("measure expert", checkpoints)
        ]
        return checkpoints[int(np.argmax(returns))]

    def train_under_trained(
        self, settings: PPOSettings, *, runs: int, measure: int, expert_return: float
    ) -> tuple[list[Checkpoint], list[np.ndarray]]:
        """Train several short runs, and score every checkpoint.

        Parameters
        ----------
        settings:
            How a run is trained.
        runs:
            Number of runs.
        measure:
            Episodes that measure a checkpoint.
        expert_return:
            Return that scores 1.

        Returns
        -------
        checkpoints, scores
            All checkpoints, and the scores (measure,) of each one's episodes.
        """
        checkpoints = [
            checkpoint
            for run in range(1, runs + 1)
            for checkpoint in self._train(f"run {run}", run, settings)
        ]
        scores = [
            self.course.measure_returns(checkpoint, measure) / expert_return
            for checkpoint in self._report_each("measure checkpoints", checkpoints)
        ]
        return checkpoints, scores

    def _train(self, name: str, run: int, settings: PPOSettings) -> list[Checkpoint]:
        """Train one run with its own seed; return its checkpoints."""
        seed = int(np.random.SeedSequence([self.seed, run]).generate_state(1)[0])

        def progress(steps: int) -> None:
            self.progress(f"train {name}", min(steps, settings.steps), settings.steps)

        checkpoints = train_ppo(self.make_env, settings, run=name, seed=seed, progress=progress)
        progress(settings.steps)
        return checkpoints

    def _report_each(self, what: str, checkpoints: Sequence[Checkpoint]) -> Iterator[Checkpoint]:
        """Yield the checkpoints, and report each when its work is done."""
        for done, checkpoint in enumerate(checkpoints):
            yield checkpoint
            self.progress(what, done + 1, len(checkpoints))
