"""Driving environments side by side and keeping what happened; knows no particular environment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_trainers.algorithms.policy import ActionBox, Policy


@dataclass(frozen=True, eq=False)
class Rollout:
    """T steps of N environments; the environments' own rewards are not kept.

    states (T, N, d) in raw units, next_states (T, N, d): what each action led to, also where the
    episode ended there. drawn (T, N, k): unit actions as the policy drew them; actions (T, N, k):
    the same clipped, as driven. terminated (T, N): a real end; ended (T, N): that or a time limit.
    """

    states: NDArray[np.float32]
    next_states: NDArray[np.float32]
    drawn: NDArray[np.float32]
    actions: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    ended: NDArray[np.bool_]


class Driver:
    """N environments of one kind, and the states they are in."""

    def __init__(self, envs: VectorEnv[Any, Any, Any]) -> None:
        """Refuse environments that the loop cannot drive; raises InvalidInputError."""
        states, actions = envs.single_observation_space, envs.single_action_space
        for name, space in (("state", states), ("action", actions)):
            if not isinstance(space, Box) or len(space.shape) != 1:
                raise InvalidInputError(f"{name} space: expected a Box of one row, found {space}")
        mode = envs.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            raise InvalidInputError(
                "environments: expected autoreset_mode SAME_STEP, so that no step is lost on a "
                f"reset, found {mode}"
            )
        assert isinstance(actions, Box) and isinstance(states, Box)
        self.width = states.shape[0]
        self.box = ActionBox(actions.low.astype(np.float32), actions.high.astype(np.float32))
        self.envs = envs
        self.states = np.zeros((envs.num_envs, self.width), np.float32)

    def reset(self, seed: int) -> NDArray[np.float32]:
        """Start every environment anew and return the initial states (N, d)."""
        states, _ = self.envs.reset(seed=seed)
        self.states = np.array(states, np.float32)
        _refuse_unknown("states", self.states)
        return self.states

    def roll(self, policy: Policy, noise: NDArray[np.float32]) -> Rollout:
        """Drive on for T steps; `noise` (T, N, k) is standard normal.

        Raises InvalidInputError for a state that is not finite.
        """
        horizon, count, _ = noise.shape
        states = np.empty((horizon, count, self.width), np.float32)
        next_states = np.empty_like(states)
        means = np.empty_like(noise)
        terminated = np.empty((horizon, count), bool)
        ended = np.empty_like(terminated)
        sigma = np.exp(policy.log_sigma)
        for t in range(horizon):
            states[t] = self.states
            means[t] = policy.mean(self.states)
            action = self.box.of_unit(means[t] + sigma * noise[t])
            observed, _, terminated[t], truncated, info = self.envs.step(action)
            self.states = np.array(observed, np.float32)
            ended[t] = terminated[t] | truncated
            next_states[t] = self.states
            for row in np.flatnonzero(ended[t]):
                next_states[t, row] = info["final_obs"][row]
            _refuse_unknown("states", next_states[t], self.states)
        drawn = means + sigma * noise
        return Rollout(states, next_states, drawn, np.clip(drawn, -1, 1), terminated, ended)


def returns(
    policy: Policy, envs: VectorEnv[Any, Any, Any], *, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Drive one episode in every environment by the mean action; return returns and lengths.

    Both (N,). For evaluation only: it reads the environment's reward. Raises InvalidInputError for
    a state or reward that is not finite.
    """
    driver = Driver(envs)
    driver.reset(seed)
    total = np.zeros(envs.num_envs)
    length = np.zeros(envs.num_envs, np.int64)
    going = np.ones(envs.num_envs, bool)
    while going.any():
        observed, reward, terminated, truncated, _ = envs.step(policy(driver.states))
        driver.states = np.array(observed, np.float32)
        _refuse_unknown("states", driver.states)
        _refuse_unknown("rewards", np.asarray(reward))
        total[going] += np.asarray(reward, np.float64)[going]
        length[going] += 1
        going &= ~(terminated | truncated)
    return total, length


def _refuse_unknown(what: str, *found: NDArray[Any]) -> None:
    for values in found:
        if not np.isfinite(values).all():
            rows = np.argwhere(~np.isfinite(values))[0]
            raise InvalidInputError(
                f"environment: expected finite {what}, found {values[tuple(rows)]}"
            )
