"""A toy environment whose episodes end when the agent wants, and models of its pairs' leverage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from ssil_data.demonstrations import Pairs
from ssil_data.leverage_model import Scored

STEPS = 20


class EndingEnv(VectorEnv[Any, Any, Any]):
    """The state is how much of the time is over. An action above 0 is a real end; others go on."""

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012
    single_observation_space = Box(-1.0, 1.0, (1,))
    single_action_space = Box(-2.0, 2.0, (1,))

    def __init__(self, count: int) -> None:
        self.num_envs = count
        self.observation_space = batch_space(self.single_observation_space, count)
        self.action_space = batch_space(self.single_action_space, count)
        self.step_number = np.zeros(count, np.int64)

    @property
    def _states(self) -> np.ndarray:
        return (2 * self.step_number / STEPS - 1).astype(np.float32)[:, None]

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[np.ndarray, dict[str, Any]]:
        self.step_number = np.zeros(self.num_envs, np.int64)
        return self._states, {}

    def step(self, actions: np.ndarray) -> tuple[Any, ...]:
        self.step_number += 1
        terminated = actions[:, 0] > 0
        truncated = ~terminated & (self.step_number == STEPS)
        info = {"final_obs": self._states}
        self.step_number[terminated | truncated] = 0
        return self._states, np.zeros(self.num_envs), terminated, truncated, info


@dataclass(frozen=True, eq=False)
class LogOddsModel:
    """A run's model whose leverage has the log-odds of a formula; it keeps what it was asked."""

    log_odds: Callable[[Pairs], np.ndarray]
    asked: list[Pairs] = field(default_factory=list)

    def __call__(self, pairs: Pairs, /) -> Scored:
        """Return leverage of these log-odds."""
        self.asked.append(pairs)
        leverage = (1 / (1 + np.exp(-self.log_odds(pairs)))).astype(np.float32)
        return Scored(1 - leverage, {}, leverage, pooled=1 - leverage)
