"""Behavior cloning of pairs with weights."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ssil_trainers.algorithms.behavior_cloning import clone
from ssil_trainers.algorithms.expert_sampler import ExpertSampler
from ssil_trainers.algorithms.networks import PolicyNetwork


def clone_lines(weight: np.ndarray) -> PolicyNetwork:
    """Clone pairs of which the first half acts 0.5 · s, the second −0.5 · s."""
    states = np.linspace(-1, 1, 100, dtype=np.float32)[:, None]
    experts = ExpertSampler(np.r_[states, states], np.r_[states, -states] / 2, weight)
    torch.manual_seed(0)
    policy = PolicyNetwork(1, 1, 16, -0.7)
    clone(policy, experts, steps=400, batch=64, rate=1e-2, rng=np.random.default_rng(0))
    return policy


def test_cloning_follows_the_pairs_with_weight_and_leaves_sigma() -> None:
    half = np.repeat(np.array([1, 0], np.float32), 100)
    at = torch.tensor([[0.8], [-0.4]])
    good = clone_lines(half)
    bad = clone_lines(1 - half)
    np.testing.assert_allclose(good(at).mean.detach(), [[0.4], [-0.2]], atol=0.03)
    np.testing.assert_allclose(bad(at).mean.detach(), [[-0.4], [0.2]], atol=0.03)
    assert good.log_sigma.item() == pytest.approx(-0.7)


def test_cloning_weighs_contradicting_pairs_by_least_squares() -> None:
    """The least squares answer to weights 3 and 1 is half of the first."""
    weight = np.repeat(np.array([3, 1], np.float32), 100)
    at = torch.tensor([[0.8], [-0.4]])
    np.testing.assert_allclose(clone_lines(weight)(at).mean.detach(), [[0.2], [-0.1]], atol=0.06)
