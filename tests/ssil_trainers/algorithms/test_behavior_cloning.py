"""Behavior cloning of pairs with weights."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from ssil_trainers.algorithms.behavior_cloning import clone
from ssil_trainers.algorithms.expert_sampler import ExpertSampler
from ssil_trainers.algorithms.networks import PolicyNetwork


def clone_lines(weight: np.ndarray, **settings: float) -> PolicyNetwork:
    """Clone pairs of which the first half acts 0.5 · s, the second −0.5 · s."""
    states = np.linspace(-1, 1, 100, dtype=np.float32)[:, None]
    experts = ExpertSampler(np.r_[states, states], np.r_[states, -states] / 2, weight)
    torch.manual_seed(0)
    policy = PolicyNetwork(1, 1, 16, -0.7)
    rng = np.random.default_rng(0)
    clone(policy, experts, steps=400, batch=64, rate=1e-2, rng=rng, **settings)
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


def norm(policy: PolicyNetwork) -> float:
    return float(sum(each.detach().square().sum() for each in policy.mean.parameters()))


def test_without_weight_decay_cloning_is_plain_adam_to_the_bit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    half = np.repeat(np.array([1, 0], np.float32), 100)
    found = [clone_lines(half), clone_lines(half, weight_decay=0.0)]

    def make_adam(
        parameters: Any, *, lr: float, weight_decay: float, fused: bool
    ) -> torch.optim.Adam:
        assert weight_decay == 0
        return torch.optim.Adam(parameters, lr=lr, fused=fused)

    monkeypatch.setattr(torch.optim, "AdamW", make_adam)
    found.append(clone_lines(half))
    states = [policy.state_dict() for policy in found]
    for name, values in states[0].items():
        for other in states[1:]:
            assert torch.equal(values, other[name]), name


def test_the_more_weight_decay_the_smaller_the_weights_and_sigma_stays() -> None:
    half = np.repeat(np.array([1, 0], np.float32), 100)
    found = [clone_lines(half, weight_decay=decay) for decay in (0.0, 0.3, 3.0)]
    norms = [norm(policy) for policy in found]
    assert norms[0] > 1.5 * norms[1] > 3 * norms[2]
    assert all(policy.log_sigma.item() == pytest.approx(-0.7) for policy in found)


def test_a_step_decays_by_its_size_whatever_the_gradient_is() -> None:
    """Adam's first step is ± rate, and the decay is added to it instead of to the gradient."""
    states = np.linspace(-1, 1, 8, dtype=np.float32)[:, None]
    experts = ExpertSampler(states, states, np.ones(8, np.float32))
    changed = []
    for decay in (0.0, 2.0):
        torch.manual_seed(0)
        policy = PolicyNetwork(1, 1, 4, -0.7)
        before = [each.detach().clone() for each in policy.mean.parameters()]
        rng = np.random.default_rng(0)
        clone(policy, experts, steps=1, batch=8, rate=1e-2, weight_decay=decay, rng=rng)
        changed.append(list(policy.mean.parameters()))
    for start, plain, decayed in zip(before, *changed, strict=True):
        torch.testing.assert_close(plain - decayed, 1e-2 * 2.0 * start, rtol=1e-3, atol=1e-6)
