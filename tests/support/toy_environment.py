"""A toy environment: a point on a line must go to a goal, which is elsewhere in every episode."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from ssil_data.features import Standardizer
from ssil_data.field import LeverageField
from ssil_trainers.algorithms.demonstrations import Demonstrations

STEPS = 20


class LineEnv(VectorEnv[Any, Any, Any]):
    """State: where the point and its goal are. The action, in [-2, 2], moves it by a tenth."""

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012
    single_observation_space = Box(-9.0, 9.0, (2,))
    single_action_space = Box(-2.0, 2.0, (1,))

    def __init__(self, count: int) -> None:
        self.num_envs = count
        self.observation_space = batch_space(self.single_observation_space, count)
        self.action_space = batch_space(self.single_action_space, count)

    def _start(self, count: int) -> np.ndarray:
        return self.random.uniform(-1, 1, (count, 2)).astype(np.float32)

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[np.ndarray, dict[str, Any]]:
        self.random = np.random.default_rng(seed)
        self.state = self._start(self.num_envs)
        self.step_number = 0
        return self.state.copy(), {}

    def step(self, actions: np.ndarray) -> tuple[Any, ...]:
        self.state[:, 0] += 0.1 * np.clip(actions[:, 0], -2, 2)
        reward = -np.abs(self.state[:, 0] - self.state[:, 1])
        self.step_number += 1
        over = np.full(self.num_envs, self.step_number == STEPS)
        info = {}
        if over.all():
            info = {"final_obs": self.state.copy()}
            self.state = self._start(self.num_envs)
            self.step_number = 0
        return self.state.copy(), reward, np.zeros(self.num_envs, bool), over, info


def expert(states: np.ndarray) -> np.ndarray:
    """Go to the goal, ever slower."""
    return np.clip(5 * (states[:, 1:] - states[:, :1]), -2, 2).astype(np.float32)


def away_from_goal(states: np.ndarray) -> np.ndarray:
    """Go away from the goal."""
    return -expert(states)


def mean_return(policy: Any, count: int = 200) -> float:
    """The mean return of a policy, which maps states (n, 2) to actions (n, 1)."""
    env = LineEnv(count)
    total = 0.0
    states, _ = env.reset(seed=7)
    for _ in range(STEPS):
        states, reward, *_ = env.step(policy(states))
        total += float(reward.mean())
    return total


def demonstrations() -> Demonstrations:
    """300 labeled pairs; 1,000 unlabeled ones by the expert, and 200 that go away from the goal."""
    runs = [_record(expert, 15, 0), _record(expert, 50, 1), _record(away_from_goal, 10, 2)]
    states, actions = (np.concatenate(part) for part in zip(*runs, strict=True))
    row = np.arange(len(states))
    leverage = np.where(row < 1300, 0.9, 0.1).astype(np.float32)
    field = LeverageField(states, leverage, row < 300, Standardizer.of(states), alpha=20.0)
    return Demonstrations(states, actions, row < 300, leverage, field)


def _record(policy: Any, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    env = LineEnv(count)
    states = []
    actions = []
    state, _ = env.reset(seed=seed)
    noise = np.random.default_rng(seed)
    for _ in range(STEPS):
        action = policy(state) + noise.normal(0, 0.1, (count, 1)).astype(np.float32)
        states.append(state)
        actions.append(action)
        state, *_ = env.step(action)
    return np.concatenate(states), np.concatenate(actions)
