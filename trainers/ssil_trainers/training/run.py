"""A training run that can be watched, stopped and resumed, and the files it leaves in its folder.

A run needs three things: what to learn from (`TrainingData`), where to practice (`make_envs`), and
how (`TrainSettings`). The algorithm itself is the `Learner`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv

from ssil_data.errors import ConflictError, InvalidInputError
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.demonstrations import Demonstrations
from ssil_trainers.algorithms.learner import Iteration, Learner
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.algorithms.policy import Policy
from ssil_trainers.algorithms.rollout import RolloutCollector, measure_returns
from ssil_trainers.algorithms.torch_threads import single_thread
from ssil_trainers.training.checkpoint import (
    CHECKPOINT,
    STORED_NAMES,
    read_checkpoint,
    write_checkpoint,
)
from ssil_trainers.training.data import TrainingData
from ssil_trainers.training.history import Evaluation, HistoryRow, to_csv

POLICY = "policy.safetensors"
CURVE = "curve.csv"

MakeEnvs = Callable[[int], VectorEnv[Any, Any, Any]]
"""Makes a vector environment of so many environments."""

Callback = Callable[[HistoryRow], None]
"""Called with each row of the learning curve: before the first iteration, and after every one."""


@dataclass(frozen=True, eq=False)
class TrainResult:
    """What training gives.

    Parameters
    ----------
    policy:
        The policy after the last iteration.
    curve:
        The learning curve, a row before the first iteration and one after each.
    """

    policy: Policy
    curve: tuple[HistoryRow, ...]


def train(
    method: str,
    data: TrainingData,
    make_envs: MakeEnvs,
    *,
    settings: TrainSettings = TrainSettings(),  # noqa: B008
    folder: Path | None = None,
    resume: bool = False,
    callback: Callback = lambda row: None,
) -> TrainResult:
    """Train a policy on demonstrations; no method reads the environment's reward.

    The same arguments on the same machine give the same bytes, however often the run was
    interrupted and resumed.

    Parameters
    ----------
    method:
        A name in `METHODS`.
    data:
        What to learn from.
    make_envs:
        Makes a vector environment of so many environments.
    settings:
        Settings of the run; the method's own take their place where it has some.
    folder:
        Where to leave a checkpoint and a policy file at every boundary, and the learning curve;
        None leaves no files.
    resume:
        Go on from the checkpoint in the folder, if there is one.
    callback:
        Called with each row of the learning curve.

    Raises
    ------
    ConflictError
        If the folder has a checkpoint and `resume` is off, or one of another run, or a policy that
        was trained for longer.
    InvalidInputError
        If the demonstrations do not fit the environment, or the method needs a run and has none.

    Examples
    --------
    >>> import gymnasium
    >>> from ssil_trainers.algorithms.demonstrations import Demonstrations
    >>> rng = np.random.default_rng(0)
    >>> states = rng.normal(size=(40, 3)).astype(np.float32)
    >>> actions = rng.uniform(-2, 2, (40, 1)).astype(np.float32)
    >>> data = TrainingData(Demonstrations(states, actions, np.ones(40, bool)))
    >>> mode = {"autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}
    >>> result = train(
    ...     "gail",
    ...     data,
    ...     lambda count: gymnasium.make_vec("Pendulum-v1", count, vector_kwargs=mode),
    ...     settings=TrainSettings(steps=64, environments=2, horizon=16, hidden=8, evaluations=1),
    ...     folder=Path("training"),
    ... )
    >>> [row.steps for row in result.curve]
    [0, 32, 64]
    >>> sorted(path.name for path in Path("training").iterdir())
    ['checkpoint.safetensors', 'curve.csv', 'policy.safetensors']
    """
    run = TrainRun(method, data, make_envs, settings=settings, folder=folder)
    return run.train(resume=resume, callback=callback)


class TrainRun:
    """One training run: `train` in two steps, so that its settings can be read in between.

    Parameters
    ----------
    method:
        A name in `METHODS`.
    data:
        What to learn from.
    make_envs:
        Makes a vector environment of so many environments.
    settings:
        Settings of the run; `TrainRun.settings` has the method's own in their place.
    folder:
        Where to leave files; None leaves none.
    """

    def __init__(
        self,
        method: str,
        data: TrainingData,
        make_envs: MakeEnvs,
        *,
        settings: TrainSettings = TrainSettings(),  # noqa: B008
        folder: Path | None = None,
    ) -> None:
        """Make the environments and an untrained learner."""
        row = METHODS[method]
        self.method = method
        self.data = data
        self.settings = row.complete(row.override(settings), data.demonstrations)
        self.folder = folder
        self.curve: list[HistoryRow] = []
        demonstrations = data.demonstrations
        standardizer = demonstrations.standardizer
        self.test_envs = make_envs(self.settings.evaluations)
        collector = RolloutCollector(make_envs(self.settings.environments))
        _check_widths(demonstrations, collector)
        with single_thread():
            self.learner = Learner(
                self.settings,
                collector=collector,
                experts=row.expert_sampler(
                    demonstrations, collector.action_box, standardizer, settings=self.settings
                ),
                shaping=row.shaping(demonstrations, self.settings),
                standardizer=standardizer,
                pair_reward=row.pair_reward(demonstrations, self.settings),
            )

    @property
    def identity(self) -> dict[str, Any]:
        """What a checkpoint must agree with to be resumed; the number of steps may differ."""
        settings = asdict(self.settings)
        del settings["steps"]
        return {
            "method": self.method,
            "settings": {STORED_NAMES.get(name, name): value for name, value in settings.items()},
            "origin": dict(self.data.identity),
        }

    def train(self, *, resume: bool = False, callback: Callback = lambda row: None) -> TrainResult:
        """Train to the end, from the folder's checkpoint or from the start.

        Parameters
        ----------
        resume:
            Go on from the checkpoint in the folder, if there is one.
        callback:
            Called with each row of the learning curve.

        Raises
        ------
        ConflictError
            As `train`.
        """
        with single_thread():
            if not self._restore(resume) and self.settings.pretrained:
                self.learner.clone()
            return self._run(callback)

    def _run(self, callback: Callback) -> TrainResult:
        """Do the iterations that are left."""
        if not self.curve:
            self._add_row(None, callback)
        if not self.settings.iterations:
            self._write_checkpoint()
        while self.learner.done < self.settings.iterations:
            if self.learner.done % self.settings.boundary == 0:
                self._write_checkpoint()
                self.learner.reset_environments()
            self._add_row(self.learner.iterate(), callback)
        policy = self._write_policy()
        for envs in (self.test_envs, self.learner.collector.envs):
            envs.close()
        return TrainResult(policy, tuple(self.curve))

    def _add_row(self, iteration: Iteration | None, callback: Callback) -> None:
        """Extend the learning curve, with an evaluation where one is due."""
        done = self.learner.done
        last = done >= self.settings.iterations
        due = last or done % self.settings.evaluate_every == 0
        row = HistoryRow(
            steps=0 if iteration is None else iteration.steps,
            iteration=iteration,
            evaluation=self._evaluate() if due else None,
        )
        self.curve.append(row)
        callback(row)

    def _evaluate(self) -> Evaluation:
        """Run an episode in every test environment; all evaluations have the same seed."""
        seed = int(np.random.SeedSequence([self.settings.seed, 5]).generate_state(1)[0]) % 2**31
        total, length = measure_returns(self.learner.snapshot(), self.test_envs, seed=seed)
        mean = float(total.mean())
        expert = self.data.expert_return
        return Evaluation(
            mean=mean,
            least=float(total.min()),
            length=float(length.mean()),
            score=None if expert is None else mean / expert,
        )

    def _write_checkpoint(self) -> None:
        """Write everything from which the next iteration can be resumed, and the policy file."""
        if self.folder is None:
            return
        write_checkpoint(self.folder, self.learner, identity=self.identity, curve=self.curve)
        self._write_policy()

    def _restore(self, resume: bool) -> bool:
        """Take over the checkpoint in the folder; return whether there was one."""
        if self.folder is None or not (self.folder / CHECKPOINT).exists():
            return False
        if not resume:
            raise ConflictError(
                f"checkpoint: {self.folder} has one already; --resume goes on from it, and another "
                "folder takes a new run"
            )
        arrays, metadata = read_checkpoint(self.folder, identity=self.identity)
        self._refuse_fewer_steps(self.folder / POLICY)
        self.learner.restore(arrays, done=metadata["done"], eta=metadata["eta"])
        self.curve = [HistoryRow.from_json(row) for row in metadata["curve"]]
        return True

    def _refuse_fewer_steps(self, path: Path) -> None:
        """Keep a policy that was trained for longer than this run would."""
        settings = self.settings
        steps = settings.iterations * settings.environments * settings.horizon
        trained = Policy.load(path).metadata["steps"] if path.exists() else 0
        if trained > steps:
            raise ConflictError(
                f"steps: expected at least the {trained:,} that the policy in {path.parent} was "
                f"trained for, found {steps:,}; another folder takes a shorter run"
            )

    def _write_policy(self) -> Policy:
        """Return the present policy, and write it with the learning curve if there is a folder."""
        evaluated = next(row for row in reversed(self.curve) if row.evaluation is not None)
        metadata = {
            **self.identity,
            "steps": self.curve[-1].steps,
            "expert_return": self.data.expert_return,
            "evaluated": {"steps": evaluated.steps, **asdict(evaluated)["evaluation"]},
        }
        policy = self.learner.snapshot(metadata)
        if self.folder is not None:
            policy.save(self.folder / POLICY)
            (self.folder / CURVE).write_text(to_csv(self.curve))
        return policy


def _check_widths(demonstrations: Demonstrations, collector: RolloutCollector) -> None:
    """Raise InvalidInputError unless demonstrations and environment have the same widths."""
    found = (demonstrations.states.shape[1], demonstrations.actions.shape[1])
    expected = (collector.state_width, len(collector.action_box.low))
    if found != expected:
        raise InvalidInputError(
            f"demonstrations: expected the state and action widths {expected} of the environment, "
            f"found {found}"
        )
