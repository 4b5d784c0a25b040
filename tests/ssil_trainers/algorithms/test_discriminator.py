"""The discriminator's update on pairs that are easy to separate."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ssil_trainers.algorithms.discriminator import DiscriminatorUpdate
from ssil_trainers.algorithms.expert_sampler import ExpertSampler
from ssil_trainers.algorithms.networks import Discriminator


def pair_tensors(offset: float, count: int = 400) -> torch.Tensor:
    return torch.randn(count, 3, generator=torch.Generator().manual_seed(int(offset))) + offset


@pytest.mark.parametrize("penalty", [0.0, 1.0])
def test_the_discriminator_learns_that_the_policys_pairs_are_high(penalty: float) -> None:
    policy = pair_tensors(1)
    expert = pair_tensors(-1).numpy()
    experts = ExpertSampler(expert[:, :2], expert[:, 2:], np.ones(len(expert), np.float32))
    discriminator = Discriminator(2, 1, 16, spectral=False)
    adam = torch.optim.Adam(discriminator.parameters(), lr=3e-3)
    update = DiscriminatorUpdate(steps=100, batch=64, gradient_penalty=penalty)
    update(discriminator, adam, pairs=policy, experts=experts, rng=np.random.default_rng(0))
    accuracy = update(
        discriminator, adam, pairs=policy, experts=experts, rng=np.random.default_rng(1)
    )
    assert accuracy > 0.85
    assert float(discriminator(policy).mean().detach()) > 0.3
    assert float(discriminator(torch.from_numpy(expert)).mean().detach()) < -0.3


def test_the_gradient_penalty_keeps_the_discriminator_gentle() -> None:
    policy = pair_tensors(1)
    expert = pair_tensors(-1).numpy()
    experts = ExpertSampler(expert[:, :2], expert[:, 2:], np.ones(len(expert), np.float32))
    slopes = []
    for penalty in (0.0, 10.0):
        torch.manual_seed(0)
        discriminator = Discriminator(2, 1, 16, spectral=False)
        adam = torch.optim.Adam(discriminator.parameters(), lr=1e-2)
        update = DiscriminatorUpdate(steps=200, batch=64, gradient_penalty=penalty)
        update(discriminator, adam, pairs=policy, experts=experts, rng=np.random.default_rng(0))
        at = torch.zeros(50, 3, requires_grad=True)
        (slope,) = torch.autograd.grad(discriminator(at).sum(), at)
        slopes.append(float(slope.norm(dim=1).mean()))
    assert slopes[1] == pytest.approx(1, abs=0.3) and slopes[0] > 1.5


def test_without_steps_the_discriminator_stays_as_it_was() -> None:
    discriminator = Discriminator(2, 1, 16, spectral=False)
    adam = torch.optim.Adam(discriminator.parameters())
    experts = ExpertSampler(np.zeros((3, 2)), np.zeros((3, 1)), np.ones(3))
    rng = np.random.default_rng(0)
    accuracy = DiscriminatorUpdate(steps=0)(
        discriminator, adam, pairs=pair_tensors(1), experts=experts, rng=rng
    )
    assert accuracy == 0.5
    assert not discriminator(pair_tensors(2)).any()
