"""Training drivers with stable-baselines3's PPO, and keeping the policies met on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize


@dataclass(frozen=True)
class PPOSettings:
    """How one PPO run is trained: steps in all, Adam's step size, rollouts between checkpoints,
    environments driven side by side and their steps between updates, and how an update is made.
    """

    steps: int
    learning_rate: float
    keep_every: int = 1
    environments: int = 8
    rollout: int = 128
    batch: int = 512
    epochs: int = 10


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """The mean action of the policy that PPO had after `steps` steps, free of torch."""

    run: str
    steps: int
    layers: tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]

    def __call__(self, state: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the action (k,) in a state (d,), clipped to [-1, 1]."""
        for weight, bias in self.layers[:-1]:
            state = np.tanh(weight @ state + bias)
        weight, bias = self.layers[-1]
        return np.clip(weight @ state + bias, -1.0, 1.0)

    def __str__(self) -> str:
        """Name the policy."""
        return f"ppo {self.run} checkpoint {self.steps:,} steps"


def train(
    make_env: Callable[[], gymnasium.Env[Any, Any]],
    settings: PPOSettings,
    *,
    run: str,
    seed: int,
    progress: Callable[[int], None] = lambda steps: None,
) -> list[Checkpoint]:
    """Train on the environment's own reward; return the checkpoints, the untrained policy first.

    progress is called with the steps taken so far, once per rollout.
    """
    envs = VecNormalize(DummyVecEnv([make_env] * settings.environments), norm_obs=False)
    keeper = _CheckpointCallback(run, settings.keep_every, progress)
    with _one_thread():
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
        learner.learn(settings.steps, callback=keeper)
    keeper.keep()
    envs.close()
    return keeper.kept


class _CheckpointCallback(BaseCallback):
    """Keeps a checkpoint where a rollout starts, just after an update."""

    def __init__(self, run: str, every: int, progress: Callable[[int], None]) -> None:
        super().__init__()
        self.kept: list[Checkpoint] = []
        self._run, self._every, self._progress = run, every, progress
        self._rollouts = 0

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self._progress(self.num_timesteps)
        if self._rollouts % self._every == 0:
            self.keep()
        self._rollouts += 1

    def keep(self) -> None:
        policy = cast(ActorCriticPolicy, self.model.policy)
        hidden = [layer for layer in policy.mlp_extractor.policy_net if _is_linear(layer)]
        layers = tuple(_copy_layer(layer) for layer in (*hidden, policy.action_net))
        self.kept.append(Checkpoint(self._run, self.model.num_timesteps, layers))


def _is_linear(layer: torch.nn.Module) -> bool:
    return isinstance(layer, torch.nn.Linear)


def _copy_layer(layer: torch.nn.Module) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    weight, bias = (parameter.detach().numpy().copy() for parameter in layer.parameters())
    return weight, bias


@contextmanager
def _one_thread() -> Iterator[None]:
    """Networks this small lose by threads, and one thread repeats its sums exactly."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
