"""Training drivers with stable-baselines3's PPO, and keeping checkpoints on the way."""

from __future__ import annotations

from collections.abc import Callable
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

from ssil_trainers.algorithms.torch_threads import single_thread


@dataclass(frozen=True)
class PPOSettings:
    """How one PPO run is trained.

    Parameters
    ----------
    steps:
        Environment steps in all.
    learning_rate:
        Adam's step size.
    keep_every:
        Rollouts between checkpoints.
    environments:
        Environments that are driven side by side.
    rollout:
        Steps of each environment between updates.
    batch, epochs:
        Pairs of a gradient step, and how often an update goes through a rollout.

    Examples
    --------
    >>> from ssil_trainers.collection.ppo import PPOSettings
    >>> PPOSettings(8_192, learning_rate=3e-4).environments
    8
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
    """The mean action of a policy that PPO had on the way, without torch.

    Parameters
    ----------
    run:
        Name of the run.
    steps:
        Environment steps before the checkpoint.
    layers:
        Weights (out, in) and biases (out,) of a perceptron with tanh between its layers.

    Examples
    --------
    >>> from ssil_trainers.collection.ppo import Checkpoint
    >>> layer = (np.ones((1, 2), dtype=np.float32), np.zeros(1, dtype=np.float32))
    >>> driver = Checkpoint("run 1", 512, (layer,))
    >>> print(driver, driver(np.array([0.25, 0.5], dtype=np.float32)))
    ppo run 1 checkpoint 512 steps [0.75]
    """

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


def train_ppo(
    make_env: Callable[[], gymnasium.Env[Any, Any]],
    settings: PPOSettings,
    *,
    run: str,
    seed: int,
    progress: Callable[[int], None] = lambda steps: None,
) -> list[Checkpoint]:
    """Train a policy on the environment's own reward.

    Parameters
    ----------
    make_env:
        Makes an environment.
    settings:
        How the run is trained.
    run:
        Name of the run.
    seed:
        The same seed gives the same checkpoints.
    progress:
        Called with the steps taken so far, once per rollout.

    Returns
    -------
    list of Checkpoint
        The untrained policy, those on the way, and the last one.

    Examples
    --------
    >>> from ssil_trainers.collection.ppo import PPOSettings, train_ppo
    >>> from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
    >>> settings = PPOSettings(64, learning_rate=3e-4, environments=2, rollout=32, batch=32)
    >>> [kept.steps for kept in train_ppo(RCLidarEnv, settings, run="demo", seed=0)]
    [0, 64]
    """
    envs = VecNormalize(DummyVecEnv([make_env] * settings.environments), norm_obs=False)
    keeper = _CheckpointCallback(run, settings.keep_every, progress)
    with single_thread():
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
        self._run = run
        self._every = every
        self._progress = progress
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
