"""One training run that can be watched, stopped and resumed: what it leaves in its folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.vector import VectorEnv

from ssil_data.errors import ConflictError, InvalidInputError
from ssil_trainers.algorithms import checkpoint as tensors
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.learner import Iteration, Learner
from ssil_trainers.algorithms.methods import METHODS, Demonstrations
from ssil_trainers.algorithms.policy import Policy
from ssil_trainers.algorithms.rollout import Driver, returns
from ssil_trainers.training.history import Evaluation, HistoryRow, to_csv

KIND = "ssil checkpoint"
CHECKPOINT, POLICY, CURVE = "checkpoint.safetensors", "policy.safetensors", "curve.csv"

Worlds = Callable[[int], VectorEnv[Any, Any, Any]]
"""Makes so many environments side by side."""


Callback = Callable[[HistoryRow], None]
"""Called after every iteration."""


@dataclass(frozen=True, eq=False)
class TrainJob:
    """What is trained, on what, and where it is kept.

    `origin` is JSON that tells the demonstrations apart: a checkpoint goes on with the same alone.
    """

    method: str
    settings: TrainSettings
    demonstrations: Demonstrations
    worlds: Worlds
    origin: Mapping[str, Any]
    expert_return: float | None = None
    folder: Path | None = None

    @property
    def identity(self) -> dict[str, Any]:
        """What a checkpoint must have been made from; the number of steps may differ."""
        settings = {key: value for key, value in asdict(self.settings).items() if key != "steps"}
        return {"method": self.method, "settings": settings, "origin": dict(self.origin)}


@dataclass(frozen=True, eq=False)
class TrainResult:
    """The policy after the last iteration, and the curve that led there."""

    policy: Policy
    curve: tuple[HistoryRow, ...]


def train(
    job: TrainJob, *, resume: bool = False, seen: Callback = lambda moment: None
) -> TrainResult:
    """Train to the end; same job, same machine, same bytes, however often it was interrupted.

    With a folder it leaves a checkpoint and a policy file at every boundary, and the curve. Raises
    ConflictError if the folder has a checkpoint and `resume` is off, or one of another job.
    """
    with _one_thread():
        return _TrainRun(job, resume=resume).run(seen)


class _TrainRun:
    """A job on its way."""

    def __init__(self, job: TrainJob, *, resume: bool) -> None:
        method = METHODS[job.method]
        self.settings = method.settings(job.settings)
        self.job = replace(job, settings=self.settings)
        of, standardiser = job.demonstrations, job.demonstrations.standardizer
        self.examiners = job.worlds(self.settings.evaluations)
        driver = Driver(job.worlds(self.settings.environments))
        _refuse_unfit(of, driver)
        experts = method.expert_sampler(of, driver.box, standardiser)
        shaping = method.shaping(of, self.settings.seed)
        self.learner = Learner(
            self.settings,
            driver=driver,
            experts=experts,
            shaping=shaping,
            standardiser=standardiser,
        )
        self.curve: list[HistoryRow] = []
        if not self._restore(resume) and self.settings.pretrained:
            self.learner.clone()

    def run(self, seen: Callback) -> TrainResult:
        if not self.curve:
            self._add(None, seen)
        if not self.settings.iterations:
            self._keep()
        while self.learner.done < self.settings.iterations:
            if self.learner.done % self.settings.boundary == 0:
                self._keep()
                self.learner.start_anew()
            self._add(self.learner.iterate(), seen)
        policy = self._keep_policy()
        for envs in (self.examiners, self.learner.driver.envs):
            envs.close()
        return TrainResult(policy, tuple(self.curve))

    def _add(self, iteration: Iteration | None, seen: Callback) -> None:
        done, due = self.learner.done, self.settings.evaluate_every
        last = done >= self.settings.iterations
        evaluation = self._evaluation() if last or done % due == 0 else None
        moment = HistoryRow(0 if iteration is None else iteration.steps, iteration, evaluation)
        self.curve.append(moment)
        seen(moment)

    def _evaluation(self) -> Evaluation:
        seed = int(np.random.SeedSequence([self.settings.seed, 5]).generate_state(1)[0]) % 2**31
        total, length = returns(self.learner.snapshot(), self.examiners, seed=seed)
        mean, expert = float(total.mean()), self.job.expert_return
        score = None if expert is None else mean / expert
        return Evaluation(mean, float(total.min()), float(length.mean()), score)

    def _keep(self) -> None:
        """Write a checkpoint from which the next iteration starts anew."""
        if self.job.folder is None:
            return
        described = {
            "kind": KIND,
            "identity": self.job.identity,
            "done": self.learner.done,
            "eta": self.learner.eta,
            "curve": [asdict(moment) for moment in self.curve],
        }
        tensors.write(self.job.folder / CHECKPOINT, self.learner.arrays(), described)
        self._keep_policy()

    def _restore(self, resume: bool) -> bool:
        """Take up the folder's checkpoint if there is one."""
        path = None if self.job.folder is None else self.job.folder / CHECKPOINT
        if path is None or not path.exists():
            return False
        if not resume:
            raise ConflictError(f"checkpoint: expected none in {path.parent}; --resume goes on")
        arrays, described = tensors.read(path, KIND)
        for name, value in self.job.identity.items():
            if described["identity"][name] != value:
                raise ConflictError(
                    f"checkpoint: expected {_differences(described['identity'][name], value)}"
                )
        self._refuse_fewer_steps(path.with_name(POLICY))
        self.learner.restore(arrays, done=described["done"], eta=described["eta"])
        self.curve = [HistoryRow.from_json(row) for row in described["curve"]]
        return True

    def _refuse_fewer_steps(self, path: Path) -> None:
        """Leave a policy alone that has learned for longer than this run is to last."""
        of = self.settings
        asked = of.iterations * of.environments * of.horizon
        found = Policy.load(path).described["steps"] if path.exists() else 0
        if found > asked:
            raise ConflictError(
                f"steps: expected at least the {found:,} that the policy in {path.parent} has "
                f"learned for, found {asked:,}; another folder takes a shorter run"
            )

    def _keep_policy(self) -> Policy:
        last = next(moment for moment in reversed(self.curve) if moment.evaluation is not None)
        described = {
            **self.job.identity,
            "steps": self.curve[-1].steps,
            "expert_return": self.job.expert_return,
            "evaluated": {"steps": last.steps, **asdict(last)["evaluation"]},
        }
        policy = self.learner.snapshot(described)
        if self.job.folder is not None:
            policy.save(self.job.folder / POLICY)
            (self.job.folder / CURVE).write_text(to_csv(self.curve))
        return policy


def _refuse_unfit(of: Demonstrations, driver: Driver) -> None:
    found = of.states.shape[1], of.actions.shape[1]
    expected = driver.width, len(driver.box.low)
    if found != expected:
        raise InvalidInputError(
            f"demonstrations: expected the state and action widths {expected} of the environment, "
            f"found {found}"
        )


def _differences(kept: Any, given: Any) -> str:
    """Say which of two JSON values differ, key by key where they are objects."""
    if not (isinstance(kept, dict) and isinstance(given, dict)):
        return f"{kept!r} as before, found {given!r}"
    names = [name for name in {**kept, **given} if kept.get(name) != given.get(name)]
    return "; ".join(f"{n} {kept.get(n)!r} as before, found {given.get(n)!r}" for n in names)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Networks this small lose by threads, and one thread repeats its sums exactly."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
