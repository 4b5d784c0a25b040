"""GAE against recurrences written out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssil_trainers.algorithms.advantage import compute_advantages


def summed(rewards, values, next_values, terminated, ended, discount, gae_lambda):
    """The defining sum Σ (γλ)^l δ_{t+l}, step by step until the episode ends, in plain Python."""
    result = []
    for t in range(len(rewards)):
        total = 0.0
        weight = 1.0
        for later in range(t, len(rewards)):
            worth = 0.0 if terminated[later] else next_values[later]
            total += weight * (rewards[later] + discount * worth - values[later])
            weight *= discount * gae_lambda
            if ended[later]:
                break
        result.append(total)
    return result


@given(st.integers(1, 12), st.integers(0, 2**32 - 1), st.floats(0, 1), st.floats(0, 1))
def test_gae_is_its_defining_sum(steps: int, seed: int, discount: float, gae_lambda: float) -> None:
    rng = np.random.default_rng(seed)
    rewards, values, next_values = rng.normal(size=(3, steps, 2, 3))
    terminated = rng.random((steps, 3)) < 0.2
    ended = terminated | (rng.random((steps, 3)) < 0.2)
    found = compute_advantages(
        rewards,
        values,
        next_values,
        terminated=terminated[:, None],
        ended=ended[:, None],
        discount=discount,
        gae_lambda=gae_lambda,
    )
    for critic in range(2):
        for env in range(3):
            expected = summed(
                rewards[:, critic, env],
                values[:, critic, env],
                next_values[:, critic, env],
                terminated[:, env],
                ended[:, env],
                discount,
                gae_lambda,
            )
            np.testing.assert_allclose(found[:, critic, env], expected, atol=1e-10)


@pytest.mark.parametrize(("terminated", "worth"), [(True, 0.0), (False, 10.0)])
def test_the_future_is_worth_the_next_state_at_a_time_limit_and_zero_at_a_real_end(
    terminated: bool, worth: float
) -> None:
    found = compute_advantages(
        np.array([1.0, 100.0]),
        np.array([2.0, 0.0]),
        np.array([10.0, 0.0]),
        terminated=np.array([terminated, True]),
        ended=np.array([True, True]),
        discount=0.5,
        gae_lambda=0.9,
    )
    assert found[0] == 1.0 + 0.5 * worth - 2.0


def test_lambda_zero_is_the_one_step_form() -> None:
    rewards, values, next_values = np.random.default_rng(0).normal(size=(3, 9))
    never = np.zeros(9, bool)
    found = compute_advantages(
        rewards, values, next_values, terminated=never, ended=never, discount=0.9, gae_lambda=0.0
    )
    np.testing.assert_allclose(found, rewards + 0.9 * next_values - values)
