"""The policy step against dense linear algebra and against stable-baselines3-contrib."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from sb3_contrib import TRPO
from stable_baselines3.common.logger import configure
from torch import Tensor, nn
from torch.func import functional_call
from torch.nn.utils import parameters_to_vector

from ssil_trainers.algorithms import trpo
from ssil_trainers.algorithms.networks import PolicyNetwork
from ssil_trainers.algorithms.trpo import TrustRegion, conjugate_gradient, fisher_product


def policy(seed: int = 0, *, hidden: int = 16) -> PolicyNetwork:
    torch.manual_seed(seed)
    made = PolicyNetwork(3, 2, hidden, -0.5)
    nn.init.normal_(made.mean[-1].weight, std=0.3)
    return made


def batch(of: PolicyNetwork, count: int = 256) -> tuple[Tensor, Tensor, Tensor]:
    """States, actions sampled from the policy, and advantages that favor a higher first action."""
    random = torch.Generator().manual_seed(3)
    states = torch.randn(count, 3, generator=random)
    now = of(states).detach()
    noise = torch.randn(count, 2, generator=random)
    actions = now.mean + now.log_sigma.exp() * noise
    advantages = noise[:, 0] * (1 + states[:, 1]) + torch.randn(count, generator=random)
    return states, actions, (advantages - advantages.mean()) / advantages.std()


def dense_fisher(of: PolicyNetwork, states: Tensor) -> Tensor:
    """The Hessian of the mean KL divergence from the policy, entry by entry."""
    shapes = {name: value.shape for name, value in of.named_parameters()}
    now = of(states).detach()

    def kl(flat: Tensor) -> Tensor:
        parts = flat.split([shape.numel() for shape in shapes.values()])
        named = {n: p.view(s) for p, (n, s) in zip(parts, shapes.items(), strict=True)}
        return now.kl_to(functional_call(of, named, (states,)))

    return torch.func.hessian(kl)(parameters_to_vector(of.parameters()).detach())


def test_fisher_product_is_the_dense_hessian_of_the_kl_divergence() -> None:
    of = policy(hidden=4).double()
    states = torch.randn(20, 3, dtype=torch.float64)
    dense = dense_fisher(of, states)
    vector = torch.randn(len(dense), dtype=torch.float64)
    product = fisher_product(of, states, damping=0.1)(vector)
    torch.testing.assert_close(product, dense @ vector + 0.1 * vector)


def test_conjugate_gradient_solves_as_a_dense_solver() -> None:
    random = np.random.default_rng(0)
    root = torch.from_numpy(random.normal(size=(12, 12)))
    matrix = root @ root.T + torch.eye(12)
    right = torch.from_numpy(random.normal(size=12))
    found = conjugate_gradient(lambda v: matrix @ v, right, steps=30, tolerance=1e-24)
    torch.testing.assert_close(found, torch.linalg.solve(matrix, right))


def test_conjugate_gradient_of_a_zero_right_hand_side_is_zero() -> None:
    assert not conjugate_gradient(lambda v: v, torch.zeros(4), steps=3).any()


@pytest.mark.parametrize("kl", [1e-3, 1e-2, 0.1])
def test_a_step_improves_the_objective_within_the_bound(kl: float) -> None:
    of = policy()
    states, actions, advantages = batch(of)
    with torch.no_grad():
        old = of(states)
        likelihood = old.log_likelihood(actions)
    step = TrustRegion(kl=kl).step(of, states, actions, advantages)
    with torch.no_grad():
        ratio = torch.exp(of(states).log_likelihood(actions) - likelihood)
        moved = float(old.kl_to(of(states)))
    assert step.taken
    assert float((ratio * advantages).mean()) > float(advantages.mean())
    assert step.kl == pytest.approx(moved, rel=1e-3)
    assert 0.3 * kl < moved < kl


def test_a_step_that_cannot_improve_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    of = policy()
    before = parameters_to_vector(of.parameters()).detach().clone()
    monkeypatch.setattr(trpo, "conjugate_gradient", lambda product, right, steps: -right)
    step = TrustRegion().step(of, *batch(of))
    assert not step.taken
    assert step.kl == 0
    torch.testing.assert_close(parameters_to_vector(of.parameters()), before, rtol=0, atol=0)


def test_a_step_that_breaks_the_bound_is_shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Fisher matrix that is taken for a ninth of itself makes the first step thrice too long."""
    of = policy()
    kl = 0.01
    states, actions, advantages = batch(of)
    old = of(states).detach()

    def too_small(*of: Any, **how: Any) -> Any:
        product = fisher_product(*of, **how)
        return lambda vector: product(vector) / 9

    monkeypatch.setattr(trpo, "fisher_product", too_small)
    step = TrustRegion(kl=kl, damping=1e-3).step(of, states, actions, advantages)
    assert step.taken
    assert 0.3 * kl < float(old.kl_to(of(states)).detach()) < kl


def test_without_advantage_and_entropy_bonus_the_policy_stays() -> None:
    of = policy()
    before = parameters_to_vector(of.parameters()).detach().clone()
    states, actions, _ = batch(of)
    assert not TrustRegion().step(of, states, actions, torch.zeros(len(states))).taken
    torch.testing.assert_close(parameters_to_vector(of.parameters()), before, rtol=0, atol=0)


def test_the_entropy_bonus_widens_the_policy() -> None:
    of = policy()
    states, actions, _ = batch(of)
    before = of.log_sigma.detach().clone()
    TrustRegion(entropy=1.0).step(of, states, actions, torch.zeros(len(states)))
    assert (of.log_sigma > before).all()


class Nowhere(gymnasium.Env):
    """Spaces alone, for the oracle."""

    observation_space = Box(-9, 9, (3,))
    action_space = Box(-9, 9, (2,))


def test_the_step_is_that_of_stable_baselines3_contrib() -> None:
    """Solved to the end, since the oracle starts its conjugate gradient from random numbers.

    It takes the mean of the KL divergence over the two action dimensions, we take their sum: its
    bound and its damping are half of ours.
    """
    of = policy(hidden=16)
    states, actions, advantages = batch(of, 512)
    oracle = TRPO(
        "MlpPolicy",
        Nowhere(),
        n_steps=len(states),
        batch_size=len(states),
        target_kl=0.005,
        cg_max_steps=60,
        cg_damping=0.05,
        n_critic_updates=1,
        normalize_advantage=False,
        policy_kwargs={"net_arch": {"pi": [16, 16], "vf": [4]}},
        device="cpu",
    )
    oracle.set_logger(configure(None, []))
    theirs = oracle.policy
    linear = [
        theirs.mlp_extractor.policy_net[0],
        theirs.mlp_extractor.policy_net[2],
        theirs.action_net,
    ]
    with torch.no_grad():
        for mine, layer in zip([of.mean[0], of.mean[2], of.mean[4]], linear, strict=True):
            layer.weight.copy_(mine.weight)
            layer.bias.copy_(mine.bias)
        theirs.log_std.copy_(of.log_sigma)
        likelihood = of(states).log_likelihood(actions).numpy()
    buffer = oracle.rollout_buffer
    buffer.observations[:, 0] = states.numpy()
    buffer.actions[:, 0] = actions.numpy()
    buffer.log_probs[:, 0] = likelihood
    buffer.advantages[:, 0] = advantages.numpy()
    buffer.full = True
    oracle.train()

    step = TrustRegion(kl=0.01, damping=0.1, conjugate_steps=60).step(
        of, states, actions, advantages
    )
    assert step.taken
    for mine, layer in zip([of.mean[0], of.mean[2], of.mean[4]], linear, strict=True):
        torch.testing.assert_close(mine.weight, layer.weight, rtol=1e-3, atol=2e-5)
        torch.testing.assert_close(mine.bias, layer.bias, rtol=1e-3, atol=2e-5)
    torch.testing.assert_close(of.log_sigma, theirs.log_std, rtol=1e-3, atol=2e-5)


def test_a_share_of_the_rows_estimates_the_fisher_matrix_of_all() -> None:
    """Every row has the same state, so a quarter of them says the same as all."""
    of = policy()
    again = policy()
    states, actions, advantages = batch(of, 128)
    states = states[:1].repeat(128, 1)
    TrustRegion(fisher_share=0.25).step(of, states, actions, advantages)
    TrustRegion(fisher_share=1.0).step(again, states, actions, advantages)
    one, other = (parameters_to_vector(net.parameters()) for net in (of, again))
    torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-5)


def test_the_rows_of_a_share_are_of_every_environment_and_every_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """64 steps of 32 environments lie row by row: every fourth row would be of eight of them."""
    of = policy()
    batches = []
    _, actions, advantages = batch(of, 64 * 32)
    step, environment = np.divmod(np.arange(64 * 32, dtype=np.float32), 32)
    states = torch.from_numpy(np.stack([step, environment, 0 * step], axis=1))

    def watched(policy: Any, states: Tensor, *, damping: float) -> Any:
        batches.append(states)
        return fisher_product(policy, states, damping=damping)

    monkeypatch.setattr(trpo, "fisher_product", watched)
    for _ in range(2):
        TrustRegion(fisher_share=0.25).step(of, states, actions, advantages)
    assert torch.equal(*batches)
    assert len(batches[0]) == len(batches[0].unique(dim=0)) == 64 * 8
    for column, count in ((0, 64), (1, 32)):
        counts = batches[0][:, column].unique(return_counts=True)[1]
        assert len(counts) == count
        assert counts.max() < 2.5 * 64 * 8 / count
