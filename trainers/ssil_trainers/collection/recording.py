"""Driving an environment once and keeping what happened; knows no policy and no simulator."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
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

    states (T, d) and positions (T, 2) in metres are from before, rewards (T,) from after the
    actions (T, k) in [-1, 1]. ending is "terminated" or "truncated"; driver names the policy.
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
    def total(self) -> float:
        """The return: the sum of the rewards."""
        return float(np.sum(self.rewards, dtype=np.float64))


@dataclass(frozen=True, eq=False)
class Selection:
    """So many pairs of a drive, from its `first` on; score is that of the whole drive."""

    drive: RecordedEpisode
    pairs: int
    score: float
    tier: str
    labeled: bool = False
    first: int = 0

    def episode(self) -> Episode:
        """Return it as a demonstration."""
        kept = slice(self.first, self.first + self.pairs)
        return Episode(
            states=self.drive.states[kept],
            actions=self.drive.actions[kept],
            rewards=self.drive.rewards[kept],
            positions=self.drive.positions[kept],
            labeled=self.labeled,
            source=self.drive.driver,
            score=self.score,
            tier=self.tier,
            ending=self.drive.ending if kept.stop == len(self.drive) else "cut",
        )


def drivers_table(taken: Sequence[Selection], tiers: Sequence[str]) -> str:
    """Return who drove how much of each tier, as a table in Markdown."""
    rows = ["| tier | driver | episodes | pairs |", "|---|---|---|---|"]
    for tier in tiers:
        of_tier = [one for one in taken if one.tier == tier]
        for driver in dict.fromkeys(one.drive.driver for one in of_tier):
            driven = [one for one in of_tier if one.drive.driver == driver]
            rows.append(
                f"| {tier} | {driver} | {len(driven)} | {sum(one.pairs for one in driven):,} |"
            )
    return "\n".join(rows)


def record(
    env: gymnasium.Env[Any, Any], policy: Policy, *, seed: int, action_noise: float = 0.0
) -> RecordedEpisode:
    """Drive one episode until it ends or is cut off; `seed` draws the start and the trembling.

    action_noise is the deviation of the normal noise on every action, whoever drives. The environment
    tells position and underlying_reward in its info.
    """
    hand = np.random.default_rng([seed, 1])
    states, actions, rewards, positions = [], [], [], []
    state, info = env.reset(seed=seed)
    terminated = truncated = False
    while not (terminated or truncated):
        meant = policy(state)
        action = np.clip(meant + action_noise * hand.standard_normal(meant.shape), -1.0, 1.0)
        action = action.astype(np.float32)
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
    """Where drivers are compared: one environment and trembling for all, new starts every time."""

    def __init__(
        self, env: gymnasium.Env[Any, Any], *, first_seed: int = 0, action_noise: float = 0.0
    ) -> None:
        """Number the episodes' seeds from `first_seed`."""
        self._env, self._seeds, self._action_noise = env, count(first_seed), action_noise

    def drive(self, policy: Policy) -> RecordedEpisode:
        """Drive the next episode."""
        return record(self._env, policy, seed=next(self._seeds), action_noise=self._action_noise)

    def returns(self, policy: Policy, episodes: int) -> NDArray[np.float64]:
        """Measure the returns of so many episodes."""
        return np.array([self.drive(policy).total for _ in range(episodes)])


def first_pairs(
    drives: Iterable[RecordedEpisode], pairs: int, *, at_most: int | None = None
) -> list[tuple[RecordedEpisode, int]]:
    """Take drives until they hold `pairs` pairs; return each with how many of its pairs to keep.

    drives must not run out. Of one drive at most `at_most` pairs are kept, its first; the last
    drive is cut to fit.
    """
    taken: list[tuple[RecordedEpisode, int]] = []
    missing = pairs
    for drive in drives:
        kept = min(len(drive), missing, at_most or len(drive))
        taken.append((drive, kept))
        missing -= kept
        if not missing:
            break
    return taken
