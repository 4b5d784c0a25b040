"""Recorded episodes on a road of one dimension whose rewards are known by hand."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from ssil_trainers.collection.recording import EvaluationCourse, record, take_pairs


class Line(gymnasium.Env[np.ndarray, np.ndarray]):
    """The state counts the steps; the reward is the new state; it ends after five steps."""

    observation_space = Box(0.0, 9.0, (1,))
    action_space = Box(-1.0, 1.0, (1,))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        self.place = 0
        return self._state()

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        self.place += 1
        state, info = self._state()
        return state, -1.0, self.place == 5, False, info | {"underlying_reward": self.place}

    def _state(self) -> tuple[np.ndarray, dict[str, Any]]:
        return np.array([self.place], dtype=np.float32), {"position": (self.place, 10.0)}


def coast(state: np.ndarray) -> np.ndarray:
    return np.zeros(1, dtype=np.float32)


def test_states_and_positions_are_from_before_and_rewards_from_after_the_actions() -> None:
    episode = record(Line(), coast, seed=0)
    assert episode.states.ravel().tolist() == [0, 1, 2, 3, 4]
    assert episode.positions.tolist() == [[step, 10] for step in range(5)]
    assert episode.rewards.tolist() == [1, 2, 3, 4, 5]
    assert (len(episode), episode.total_reward, episode.ending) == (5, 15.0, "terminated")


def test_noise_on_actions_is_drawn_from_the_seed_and_clipped() -> None:
    episodes = [record(Line(), coast, seed=seed, action_noise=2.0) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(episodes[0].actions, episodes[1].actions)
    assert (episodes[0].actions != episodes[2].actions).any()
    assert all(np.abs(episode.actions).max() <= 1 for episode in episodes)
    assert record(Line(), coast, seed=1).actions.tolist() == [[0]] * 5


def test_a_course_gives_every_episode_another_seed() -> None:
    course = EvaluationCourse(Line(), first_seed=3, action_noise=0.1)
    first = course.drive(coast)
    second = course.drive(coast)
    np.testing.assert_array_equal(
        second.actions, record(Line(), coast, seed=4, action_noise=0.1).actions
    )
    assert (first.actions != second.actions).any()
    assert course.measure_returns(coast, 2).tolist() == [15.0, 15.0]


def test_the_last_episode_is_cut_so_that_the_pairs_are_exactly_as_many() -> None:
    course = EvaluationCourse(Line())
    episodes = iter(lambda: course.drive(coast), None)
    assert [pairs for _, pairs in take_pairs(episodes, 12)] == [5, 5, 2]
    assert [pairs for _, pairs in take_pairs(episodes, 10)] == [5, 5]
    assert [pairs for _, pairs in take_pairs(episodes, 7, per_episode=3)] == [3, 3, 1]
