"""Rollouts against environments whose every step is known."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardizer
from ssil_trainers.algorithms.policy import Policy
from ssil_trainers.algorithms.rollout import RolloutCollector, measure_returns


class Counter(gymnasium.Env):
    """The state counts the steps of the episode from 100 × the seed; it remembers its actions."""

    observation_space = Box(-np.inf, np.inf, (1,))
    action_space = Box(-3.0, 3.0, (1,))

    def __init__(self, limit: int, *, terminates: bool) -> None:
        self.limit = limit
        self.terminates = terminates
        self.actions: list[float] = []

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:
        self.start = self.start if seed is None else 100 * seed
        self.steps = 0
        return np.array([self.start], np.float32), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        self.actions.append(float(action[0]))
        self.steps += 1
        over = self.steps == self.limit
        state = np.array([self.start + self.steps], np.float32)
        return state, 1.0, over and self.terminates, over and not self.terminates, {}


def counters(mode: AutoresetMode = AutoresetMode.SAME_STEP) -> SyncVectorEnv:
    makers = [
        lambda: Counter(3, terminates=True),
        lambda: Counter(4, terminates=False),
    ]
    return SyncVectorEnv(makers, autoreset_mode=mode)


def still(envs: Any, mean: float = 0.0) -> Policy:
    """The same mean action everywhere, with σ = 1 in unit actions."""
    layer = (np.zeros((1, 1), np.float32), np.array([mean], np.float32))
    standardizer = Standardizer(np.zeros(1, np.float32), np.ones(1, np.float32))
    return Policy(
        standardizer, (layer,), np.zeros(1, np.float32), RolloutCollector(envs).action_box
    )


def test_every_step_is_kept_with_the_state_it_led_to_also_at_an_end() -> None:
    envs = counters()
    collector = RolloutCollector(envs)
    np.testing.assert_array_equal(collector.reset(seed=1), [[100], [200]])
    rollout = collector.collect(still(envs), np.zeros((5, 2, 1), np.float32))
    assert rollout.states[:, 0, 0].tolist() == [100, 101, 102, 100, 101]
    assert rollout.next_states[:, 0, 0].tolist() == [101, 102, 103, 101, 102]
    assert rollout.states[:, 1, 0].tolist() == [200, 201, 202, 203, 200]
    assert rollout.next_states[:, 1, 0].tolist() == [201, 202, 203, 204, 201]
    assert rollout.terminated.T.tolist() == [[False, False, True, False, False], [False] * 5]
    assert rollout.ended.T.tolist() == [
        [False, False, True, False, False],
        [False, False, False, True, False],
    ]
    assert collector.collect(still(envs), np.zeros((1, 2, 1), np.float32)).states[0, 0, 0] == 102


def test_actions_are_sampled_around_the_mean_and_clipped_before_they_are_taken() -> None:
    envs = counters()
    collector = RolloutCollector(envs)
    collector.reset(seed=1)
    noise = np.array([[[0.2], [-9.0]], [[-0.7], [9.0]]], np.float32)
    rollout = collector.collect(still(envs, mean=0.5), noise)
    np.testing.assert_allclose(
        rollout.sampled_actions[..., 0], [[0.7, -8.5], [-0.2, 9.5]], rtol=1e-6
    )
    np.testing.assert_allclose(rollout.actions[..., 0], [[0.7, -1], [-0.2, 1]], rtol=1e-6)
    taken = envs.get_attr("actions")
    np.testing.assert_allclose(taken, [[2.1, -0.6], [-3, 3]], rtol=1e-5)


def test_returns_count_the_first_episode_of_every_environment() -> None:
    total, length = measure_returns(still(counters()), counters(), seed=1)
    assert total.tolist() == [3, 4]
    assert length.tolist() == [3, 4]


def test_an_environment_that_loses_a_step_on_a_reset_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"SAME_STEP.*found .*NEXT_STEP"):
        RolloutCollector(counters(AutoresetMode.NEXT_STEP))


def test_spaces_that_are_no_boxes_of_one_row_are_refused() -> None:
    class Chooser(Counter):
        action_space = Discrete(2)  # pyright: ignore

    class Picture(Counter):
        observation_space = Box(0, 1, (4, 4))

    for kind, name in ((Chooser, "action"), (Picture, "state")):
        envs = SyncVectorEnv(
            [lambda kind=kind: kind(3, terminates=True)], autoreset_mode=AutoresetMode.SAME_STEP
        )
        with pytest.raises(InvalidInputError, match=f"{name} space: expected a one-dim"):
            RolloutCollector(envs)


class Broken(Counter):
    """A counter whose state, last state or reward is not finite from the second step on."""

    def __init__(self, what: str) -> None:
        super().__init__(3, terminates=True)
        self.what = what

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        state, reward, terminated, truncated, info = super().step(action)
        if (self.what == "state" and self.steps == 2) or (self.what == "last" and terminated):
            state = state * np.nan
        return state, np.inf if self.what == "reward" else reward, terminated, truncated, info


@pytest.mark.parametrize("what", ["state", "last", "reward"])
def test_a_state_or_reward_that_is_not_finite_is_refused_at_once(what: str) -> None:
    def envs() -> SyncVectorEnv:
        makers = [lambda: Counter(3, terminates=True), lambda: Broken(what)]
        return SyncVectorEnv(makers, autoreset_mode=AutoresetMode.SAME_STEP)

    broken = envs()
    collector = RolloutCollector(broken)
    collector.reset(seed=1)
    noise = np.zeros((9, 2, 1), np.float32)
    if what == "reward":
        assert collector.collect(still(broken), noise).ended.any()
    else:
        with pytest.raises(
            InvalidInputError, match=r"environment: expected finite states, found nan"
        ):
            collector.collect(still(broken), noise)
        assert broken.get_attr("steps")[0] == (2 if what == "state" else 0)
    if what != "last":
        with pytest.raises(InvalidInputError, match=f"expected finite {what}s, found (nan|inf)"):
            measure_returns(still(envs()), envs(), seed=1)


def test_a_start_that_is_not_finite_is_refused() -> None:
    class Nowhere(Counter):
        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
            return np.full(1, np.nan, np.float32), {}

    envs = SyncVectorEnv(
        [lambda: Nowhere(3, terminates=True)], autoreset_mode=AutoresetMode.SAME_STEP
    )
    with pytest.raises(InvalidInputError, match="expected finite states, found nan"):
        RolloutCollector(envs).reset(seed=1)
