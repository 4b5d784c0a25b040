"""Training experts with stable-baselines3's PPO, and every policy met on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize


@dataclass(frozen=True)
class PPOSettings:
    """How the experts are trained: the length of a run, and PPO's own settings.

    Every rollout of the first `early` steps leaves a checkpoint, afterwards one in `late_every`.
    """

    steps: int = 300_000
    early: int = 40_000
    late_every: int = 20
    environments: int = 8
    rollout: int = 128
    batch: int = 512
    epochs: int = 10
    learning_rate: float = 3e-4


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A policy as PPO left it after `steps` steps: its mean action, clipped to [-1, 1]."""

    run: int
    steps: int
    layers: tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]

    def __call__(self, state: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the mean action (k,) in a state (d,): tanh layers and a linear one."""
        for weight, bias in self.layers[:-1]:
            state = np.tanh(weight @ state + bias)
        weight, bias = self.layers[-1]
        return np.clip(weight @ state + bias, -1.0, 1.0)

    def __str__(self) -> str:
        """Name the policy."""
        return f"ppo run {self.run} checkpoint {self.steps:,} steps"


def train(
    make_env: Callable[[], gymnasium.Env[Any, Any]],
    settings: PPOSettings,
    *,
    seed: int,
    run: int = 0,
    progress: Callable[[int], None] = lambda steps: None,
) -> list[Checkpoint]:
    """Train one PPO policy on the environment's own reward; return its checkpoints in order.

    progress is called with the steps taken so far, once per rollout.
    """
    envs = VecNormalize(DummyVecEnv([make_env] * settings.environments), norm_obs=False)
    learner = PPO(
        "MlpPolicy",
        envs,
        learning_rate=settings.learning_rate,
        n_steps=settings.rollout,
        batch_size=settings.batch,
        n_epochs=settings.epochs,
        seed=seed,
        device="cpu",
    )
    keeper = _Keeper(settings, run, progress)
    learner.learn(settings.steps, callback=keeper)
    keeper.keep()
    envs.close()
    return keeper.kept


class _Keeper(BaseCallback):
    """Keeps a checkpoint at the start of a rollout, when the last update is done."""

    def __init__(self, settings: PPOSettings, run: int, progress: Callable[[int], None]) -> None:
        super().__init__()
        self.kept: list[Checkpoint] = []
        self._settings, self._run, self._progress = settings, run, progress
        self._rollouts = 0

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self._progress(self.num_timesteps)
        early = self.num_timesteps < self._settings.early
        if early or self._rollouts % self._settings.late_every == 0:
            self.keep()
        self._rollouts += 1

    def keep(self) -> None:
        policy = self.model.policy
        linear = [layer for layer in policy.mlp_extractor.policy_net if hasattr(layer, "weight")]
        layers = tuple(
            (_copied(layer.weight), _copied(layer.bias)) for layer in (*linear, policy.action_net)
        )
        self.kept.append(Checkpoint(self._run, self.model.num_timesteps, layers))


def _copied(parameter: torch.Tensor) -> NDArray[np.float32]:
    return parameter.detach().numpy().copy()
