"""Driving an environment episode by episode and keeping what happened.

It knows no policy and no simulator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import count
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Episode

Policy = Callable[[NDArray[np.float32]], NDArray[np.float32]]
"""From one state (d,) to one action (k,)."""


@dataclass(frozen=True, eq=False)
class RecordedEpisode:
    """One whole episode of T steps as it was driven.

    Parameters
    ----------
    states:
        What the policy saw before each action (T, d).
    actions:
        What it did, noise included, in [-1, 1] (T, k).
    rewards:
        Underlying reward after each action (T,).
    positions:
        x, y before each action [m] (T, 2).
    ending:
        "terminated" or "truncated".
    driver:
        Name of the policy.

    Examples
    --------
    >>> from ssil_trainers.collection.recording import RecordedEpisode
    >>> numbers = np.ones((5, 2), dtype=np.float32)
    >>> episode = RecordedEpisode(numbers, numbers, numbers[:, 0], numbers, "truncated", "me")
    >>> len(episode), episode.total_reward
    (5, 5.0)
    """

    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    rewards: NDArray[np.float32]
    positions: NDArray[np.float32]
    ending: str
    driver: str

    def __len__(self) -> int:
        """Count the steps."""
        return len(self.states)

    @property
    def total_reward(self) -> float:
        """The return, the sum of the rewards: more is better."""
        return float(np.sum(self.rewards, dtype=np.float64))


@dataclass(frozen=True, eq=False)
class Selection:
    """The part of a recorded episode that a dataset keeps.

    Parameters
    ----------
    recorded:
        The whole episode.
    pairs:
        Number of pairs that are kept.
    score:
        Return of the whole episode over the expert's mean return: 1 is as good as the expert.
    tier:
        Name of the quality tier.
    labeled:
        Whether the pairs are labeled as expert's.
    first:
        First pair that is kept.

    Examples
    --------
    >>> from ssil_trainers.collection.recording import RecordedEpisode, Selection
    >>> numbers = np.ones((5, 2), dtype=np.float32)
    >>> recorded = RecordedEpisode(numbers, numbers, numbers[:, 0], numbers, "truncated", "me")
    >>> episode = Selection(recorded, pairs=3, score=1.0, tier="expert").to_episode()
    >>> len(episode), episode.ending
    (3, 'cut')
    """

    recorded: RecordedEpisode
    pairs: int
    score: float
    tier: str
    labeled: bool = False
    first: int = 0

    def to_episode(self) -> Episode:
        """Return the kept pairs as a demonstration; its ending is "cut" if they end earlier."""
        kept = slice(self.first, self.first + self.pairs)
        return Episode(
            states=self.recorded.states[kept],
            actions=self.recorded.actions[kept],
            rewards=self.recorded.rewards[kept],
            positions=self.recorded.positions[kept],
            labeled=self.labeled,
            source=self.recorded.driver,
            score=self.score,
            tier=self.tier,
            ending=self.recorded.ending if kept.stop == len(self.recorded) else "cut",
        )


def record(
    env: gymnasium.Env[Any, Any], policy: Policy, *, seed: int, action_noise: float = 0.0
) -> RecordedEpisode:
    """Drive one episode until it ends or is cut off.

    Parameters
    ----------
    env:
        Environment whose info has position (2,) and, after a step, underlying_reward.
    policy:
        From a state to an action; str(policy) names the driver.
    seed:
        Draws the start and the noise on the actions.
    action_noise:
        Deviation of the normal noise on every action, the same for every policy.

    Returns
    -------
    RecordedEpisode
        All its steps.

    Examples
    --------
    >>> from ssil_trainers.collection.recording import record
    >>> from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
    >>> def drive_straight(state):
    ...     return np.zeros(1, dtype=np.float32)
    >>> episode = record(RCLidarEnv("hall"), drive_straight, seed=0)
    >>> episode.ending, len(episode) - episode.total_reward
    ('terminated', 1.0)
    """
    noise = np.random.default_rng([seed, 1])
    states = []
    actions = []
    rewards = []
    positions = []
    state, info = env.reset(seed=seed)
    terminated = truncated = False
    while not (terminated or truncated):
        intended = policy(state)
        noisy = intended + action_noise * noise.standard_normal(intended.shape)
        action = np.clip(noisy, -1.0, 1.0).astype(np.float32)
        states.append(state)
        actions.append(action)
        positions.append(info["position"])
        state, _, terminated, truncated, info = env.step(action)
        rewards.append(info["underlying_reward"])
    return RecordedEpisode(
        states=np.array(states, dtype=np.float32),
        actions=np.array(actions, dtype=np.float32),
        rewards=np.array(rewards, dtype=np.float32),
        positions=np.array(positions, dtype=np.float32),
        ending="terminated" if terminated else "truncated",
        driver=str(policy),
    )


class EvaluationCourse:
    """Where policies are compared: one environment, the same noise for all, ever new starts.

    Parameters
    ----------
    env:
        The environment, as for `record`.
    first_seed:
        Seed of the first episode; every episode has the next one.
    action_noise:
        As for `record`.

    Examples
    --------
    >>> from ssil_trainers.collection.pure_pursuit import PurePursuit
    >>> from ssil_trainers.collection.recording import EvaluationCourse
    >>> from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
    >>> env = RCLidarEnv("hall", episode_steps=50)
    >>> EvaluationCourse(env).measure_returns(PurePursuit(env, ahead=1.4), 3)
    array([50., 50., 50.])
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], *, first_seed: int = 0, action_noise: float = 0.0
    ) -> None:
        """Number the seeds."""
        self._env = env
        self._seeds = count(first_seed)
        self._action_noise = action_noise

    def drive(self, policy: Policy) -> RecordedEpisode:
        """Record the next episode.

        Parameters
        ----------
        policy:
            Who drives it.
        """
        return record(self._env, policy, seed=next(self._seeds), action_noise=self._action_noise)

    def measure_returns(self, policy: Policy, episodes: int) -> NDArray[np.float64]:
        """Return the returns of the next episodes: more is better.

        Parameters
        ----------
        policy:
            Who drives them.
        episodes:
            How many are driven.
        """
        return np.array([self.drive(policy).total_reward for _ in range(episodes)])


def take_pairs(
    episodes: Iterable[RecordedEpisode], pairs: int, *, per_episode: int | None = None
) -> list[tuple[RecordedEpisode, int]]:
    """Take episodes until they hold enough pairs; the last one is cut to fit.

    Parameters
    ----------
    episodes:
        Recorded one after the other; they must not run out.
    pairs:
        Number of pairs in all.
    per_episode:
        Most pairs that are kept of one episode; None keeps whole episodes.

    Returns
    -------
    list of (RecordedEpisode, int)
        Each episode, and how many of its pairs are kept.

    Examples
    --------
    >>> from ssil_trainers.collection.recording import RecordedEpisode, take_pairs
    >>> numbers = np.zeros((5, 2), dtype=np.float32)
    >>> episode = RecordedEpisode(numbers, numbers, numbers[:, 0], numbers, "truncated", "me")
    >>> [kept for _, kept in take_pairs([episode] * 3, 12)]
    [5, 5, 2]
    """
    taken: list[tuple[RecordedEpisode, int]] = []
    missing = pairs
    for episode in episodes:
        kept = min(len(episode), missing, per_episode or len(episode))
        taken.append((episode, kept))
        missing -= kept
        if not missing:
            break
    return taken
