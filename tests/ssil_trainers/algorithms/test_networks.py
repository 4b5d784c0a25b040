"""The networks against torch's own distributions and against networks one by one."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn
from torch.distributions import Independent, Normal, kl_divergence

from ssil_trainers.algorithms.networks import (
    Critics,
    Discriminator,
    Gaussian,
    PolicyNetwork,
    perceptron,
)


def gaussian(seed: int) -> Gaussian:
    random = torch.Generator().manual_seed(seed)
    return Gaussian(torch.randn(7, 3, generator=random), torch.randn(3, generator=random) / 2)


def as_torch(one: Gaussian) -> Independent:
    return Independent(Normal(one.mean, one.log_sigma.exp().expand(7, 3)), 1)


def test_gaussian_agrees_with_torch_distributions() -> None:
    one = gaussian(0)
    other = gaussian(1)
    actions = torch.randn(7, 3)
    torch.testing.assert_close(one.log_likelihood(actions), as_torch(one).log_prob(actions))
    torch.testing.assert_close(one.entropy(), as_torch(one).entropy()[0])
    expected = kl_divergence(as_torch(one), as_torch(other)).mean()
    torch.testing.assert_close(one.kl_to(other), expected)


def test_two_critics_are_two_networks() -> None:
    critics = Critics(5, 8, discount=0.9)
    for weight in critics.parameters():
        nn.init.normal_(weight)
    states = torch.randn(11, 5)
    for number in range(2):
        x = states
        for layer, (weight, bias) in enumerate(zip(critics.weights, critics.biases, strict=True)):
            x = x @ weight[number] + bias[number]
            x = torch.tanh(x) if layer < 2 else x
        torch.testing.assert_close(critics(states)[number], 10 * x[:, 0])


def test_a_third_critic_begins_as_the_second_and_draws_no_random_numbers() -> None:
    torch.manual_seed(0)
    two = Critics(5, 8, discount=0.9)
    after_two = torch.rand(1)
    torch.manual_seed(0)
    three = Critics(5, 8, discount=0.9, uncentered=True)
    assert torch.rand(1) == after_two
    for of_two, of_three in zip(two.parameters(), three.parameters(), strict=True):
        torch.testing.assert_close(of_three[:2], of_two, rtol=0, atol=0)
        torch.testing.assert_close(of_three[2], of_two[1], rtol=0, atol=0)


def test_a_critic_of_no_reward_stays_zero_while_the_other_learns() -> None:
    critics = Critics(5, 8, discount=0.9)
    adam = torch.optim.Adam(critics.parameters(), lr=0.1, fused=True)
    states = torch.randn(32, 5)
    targets = torch.stack([torch.randn(32), torch.zeros(32)])
    for _ in range(5):
        adam.zero_grad()
        (critics(states) - targets).square().mean().backward()
        adam.step()
    of_d, of_c = critics(states).detach()
    assert of_d.abs().max() > 0.1
    assert not of_c.any()


def test_the_discriminator_begins_undecided_and_its_reward_is_log_two() -> None:
    discriminator = Discriminator(5, 2, 8, spectral=False)
    reward = discriminator.reward(torch.randn(9, 7)).detach()
    np.testing.assert_allclose(reward, np.log(2), rtol=1e-6)


def test_the_reward_is_minus_log_d_where_d_is_high_for_the_policy() -> None:
    discriminator = Discriminator(5, 2, 8, spectral=False)
    nn.init.normal_(discriminator.net[-1].weight)
    pairs = torch.randn(9, 7)
    high = torch.sigmoid(discriminator(pairs)).detach()
    torch.testing.assert_close(discriminator.reward(pairs).detach(), -torch.log(high))


def test_a_spectral_discriminator_is_lipschitz() -> None:
    torch.manual_seed(0)
    discriminator = Discriminator(5, 2, 8, spectral=True)
    with torch.no_grad():
        for name, weight in discriminator.named_parameters():
            weight.mul_(50 if name.endswith("original") else 1)
        for _ in range(50):
            discriminator(torch.randn(3, 7))
        one, other = torch.randn(2, 200, 7)
        steepness = (discriminator(one) - discriminator(other)).abs() / (one - other).norm(dim=1)
    assert 1e-3 < steepness.max() <= 1 + 1e-3


def test_layers_are_copies_in_the_order_of_the_network() -> None:
    policy = PolicyNetwork(4, 2, 8, -0.7)
    layers = policy.layers()
    assert [weight.shape for weight, _ in layers] == [(4, 8), (8, 8), (8, 2)]
    layers[0][0][:] = 0
    assert policy.layers()[0][0].any()


@pytest.mark.parametrize("last", [0.0, 0.01])
def test_the_last_layer_is_scaled_by_its_factor(last: float) -> None:
    *_, weight, _ = perceptron(3, 16, 4, last=last).parameters()
    torch.testing.assert_close(weight @ weight.T, last**2 * torch.eye(4), atol=1e-6, rtol=1e-4)
