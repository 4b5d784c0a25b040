"""Stepping vector environments with a policy and recording the steps; imports no simulator."""

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
    """T steps of N environments. The environments' own rewards are not recorded.

    Parameters
    ----------
    states:
        States in which the steps began, (T, N, d), in raw units.
    next_states:
        States that the actions led to, (T, N, d): the last state of an episode where it ended, not
        the first one of the next episode.
    sampled_actions:
        Unit actions as the policy sampled them, (T, N, k), not clipped.
    actions:
        The same clipped to [−1, 1], as they were taken.
    terminated:
        Where an episode really ended, (T, N).
    ended:
        Where it ended in any way, by a real end or by a time limit, (T, N).
    steps:
        Place of each step in its episode, (T, N); an episode that began before the rollout goes on
        with its numbers.
    """

    states: NDArray[np.float32]
    next_states: NDArray[np.float32]
    sampled_actions: NDArray[np.float32]
    actions: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    ended: NDArray[np.bool_]
    steps: NDArray[np.int64]


class RolloutCollector:
    """N environments of one kind, the states they are in, and the steps taken from there.

    Parameters
    ----------
    envs:
        Vector environment with one-dimensional `Box` spaces that resets an ended episode in the
        same step (`AutoresetMode.SAME_STEP`).

    Raises
    ------
    InvalidInputError
        For other spaces or another autoreset mode.

    Examples
    --------
    >>> import gymnasium
    >>> envs = gymnasium.make_vec(
    ...     "Pendulum-v1", 2, vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP}
    ... )
    >>> collector = RolloutCollector(envs)
    >>> collector.reset(seed=0).shape
    (2, 3)
    >>> collector.action_box.low, collector.action_box.high
    (array([-2.], dtype=float32), array([2.], dtype=float32))
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any]) -> None:
        """Check the spaces; the states are known after `reset`."""
        states = envs.single_observation_space
        actions = envs.single_action_space
        for name, space in (("state", states), ("action", actions)):
            if not isinstance(space, Box) or len(space.shape) != 1:
                raise InvalidInputError(
                    f"{name} space: expected a one-dimensional Box, found {space}"
                )
        mode = envs.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            raise InvalidInputError(
                "environments: expected autoreset_mode SAME_STEP, so that no step is lost on a "
                f"reset, found {mode}"
            )
        assert isinstance(actions, Box) and isinstance(states, Box)
        self.state_width = states.shape[0]
        self.action_box = ActionBox(actions.low.astype(np.float32), actions.high.astype(np.float32))
        self.envs = envs
        self.states = np.zeros((envs.num_envs, self.state_width), np.float32)
        self.step_numbers = np.zeros(envs.num_envs, np.int64)

    def reset(self, seed: int) -> NDArray[np.float32]:
        """Reset every environment.

        Parameters
        ----------
        seed:
            Seed of the environments.

        Returns
        -------
        :
            The initial states, (N, d).

        Raises
        ------
        InvalidInputError
            For a state that is not finite.
        """
        states, _ = self.envs.reset(seed=seed)
        self.states = np.array(states, np.float32)
        self.step_numbers = np.zeros(self.envs.num_envs, np.int64)
        _refuse_nonfinite("states", self.states)
        return self.states

    def collect(self, policy: Policy, noise: NDArray[np.float32]) -> Rollout:
        """Take T steps with actions mean(s) + σ · noise, going on from the present states.

        Parameters
        ----------
        policy:
            The policy that acts.
        noise:
            Standard normal numbers, (T, N, k).

        Returns
        -------
        :
            The steps taken.

        Raises
        ------
        InvalidInputError
            For a state that is not finite.
        """
        horizon, count, _ = noise.shape
        states = np.empty((horizon, count, self.state_width), np.float32)
        next_states = np.empty_like(states)
        means = np.empty_like(noise)
        terminated = np.empty((horizon, count), bool)
        ended = np.empty_like(terminated)
        steps = np.empty((horizon, count), np.int64)
        sigma = np.exp(policy.log_sigma)
        for t in range(horizon):
            states[t] = self.states
            steps[t] = self.step_numbers
            means[t] = policy.mean(self.states)
            action = self.action_box.from_unit(means[t] + sigma * noise[t])
            observed, _, terminated[t], truncated, info = self.envs.step(action)
            self.states = np.array(observed, np.float32)
            ended[t] = terminated[t] | truncated
            self.step_numbers = np.where(ended[t], 0, self.step_numbers + 1)
            next_states[t] = self.states
            # An ended environment is already in its next episode: its last state is in the info.
            for row in np.flatnonzero(ended[t]):
                next_states[t, row] = info["final_obs"][row]
            _refuse_nonfinite("states", next_states[t], self.states)
        sampled = means + sigma * noise
        actions = np.clip(sampled, -1, 1)
        return Rollout(states, next_states, sampled, actions, terminated, ended, steps)


def measure_returns(
    policy: Policy, envs: VectorEnv[Any, Any, Any], *, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Run an episode in every environment with the mean action; higher returns are better.

    For evaluation only: nothing else reads the environment's reward.

    Parameters
    ----------
    policy:
        The policy that acts, without noise.
    envs:
        N environments, as `RolloutCollector` takes them.
    seed:
        Seed of the environments.

    Returns
    -------
    :
        Sum of rewards (N,) and number of steps (N,) of each environment's first episode.

    Raises
    ------
    InvalidInputError
        For a state or reward that is not finite.

    Examples
    --------
    >>> import gymnasium
    >>> envs = gymnasium.make_vec(
    ...     "Pendulum-v1", 2, vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP}
    ... )
    >>> from ssil_data.features import Standardizer
    >>> layer = (np.zeros((3, 1), np.float32), np.zeros(1, np.float32))
    >>> standardizer = Standardizer(np.zeros(3, np.float32), np.ones(3, np.float32))
    >>> policy = Policy(
    ...     standardizer, (layer,), np.zeros(1, np.float32), RolloutCollector(envs).action_box
    ... )
    >>> returns, lengths = measure_returns(policy, envs, seed=0)
    >>> bool((returns < 0).all()), lengths.tolist()
    (True, [200, 200])
    """
    collector = RolloutCollector(envs)
    collector.reset(seed)
    total = np.zeros(envs.num_envs)
    length = np.zeros(envs.num_envs, np.int64)
    running = np.ones(envs.num_envs, bool)
    while running.any():
        observed, reward, terminated, truncated, _ = envs.step(policy(collector.states))
        collector.states = np.array(observed, np.float32)
        _refuse_nonfinite("states", collector.states)
        _refuse_nonfinite("rewards", np.asarray(reward))
        total[running] += np.asarray(reward, np.float64)[running]
        length[running] += 1
        running &= ~(terminated | truncated)
    return total, length


def _refuse_nonfinite(what: str, *arrays: NDArray[Any]) -> None:
    """Raise InvalidInputError that names the first number that is not finite."""
    for values in arrays:
        if not np.isfinite(values).all():
            place = tuple(np.argwhere(~np.isfinite(values))[0])
            raise InvalidInputError(f"environment: expected finite {what}, found {values[place]}")
