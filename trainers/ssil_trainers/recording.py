"""Driving an environment once and keeping what happened; knows no policy and no simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

Policy = Callable[[NDArray[np.float32]], NDArray[np.float32]]
"""From one state (d,) to one action (k,)."""


@dataclass(frozen=True, eq=False)
class Drive:
    """One whole episode of T steps as it was driven.

    states (T, d) and positions (T, 2) in metres are from before, rewards (T,) from after the
    actions (T, k). ending is "terminated" or "truncated".
    """

    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    rewards: NDArray[np.float32]
    positions: NDArray[np.float32]
    ending: str

    def __len__(self) -> int:
        """Count the steps."""
        return len(self.states)

    @property
    def total(self) -> float:
        """The return: the sum of the rewards."""
        return float(np.sum(self.rewards, dtype=np.float64))


def record(env: gymnasium.Env[Any, Any], policy: Policy, *, seed: int) -> Drive:
    """Drive one episode from the start that `seed` draws, until it ends or is cut off.

    The environment tells position and underlying_reward in its info.
    """
    states, actions, rewards, positions = [], [], [], []
    state, info = env.reset(seed=seed)
    terminated = truncated = False
    while not (terminated or truncated):
        action = policy(state)
        states.append(state)
        actions.append(action)
        positions.append(info["position"])
        state, _, terminated, truncated, info = env.step(action)
        rewards.append(info["underlying_reward"])
    return Drive(
        states=np.array(states, dtype=np.float32),
        actions=np.array(actions, dtype=np.float32),
        rewards=np.array(rewards, dtype=np.float32),
        positions=np.array(positions, dtype=np.float32),
        ending="terminated" if terminated else "truncated",
    )
