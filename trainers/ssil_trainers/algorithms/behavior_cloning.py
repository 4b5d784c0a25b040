"""Behaviour cloning: the policy's mean learns the experts' actions; weights make it selective."""

from __future__ import annotations

import numpy as np
import torch

from ssil_trainers.algorithms.expert_sampler import ExpertSampler
from ssil_trainers.algorithms.networks import PolicyNetwork


def clone(
    policy: PolicyNetwork,
    experts: ExpertSampler,
    *,
    steps: int,
    batch: int,
    rate: float,
    rng: np.random.Generator,
) -> float:
    """Minimise the squared error of the mean by Adam; return its mean over the last tenth.

    Pairs are drawn by their weight: with leverage as the weight this is leverage-weighted cloning,
    with 1 for labeled pairs and 0 for others the plain one. log σ stays, so that a policy trained
    further still explores.
    """
    optimiser = torch.optim.Adam(policy.mean.parameters(), lr=rate, fused=True)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, max(1, steps))
    errors = []
    for _ in range(steps):
        states, actions = experts.draw(batch, rng)
        error = (policy.mean(states) - actions).square().mean()
        optimiser.zero_grad()
        error.backward()
        optimiser.step()
        schedule.step()
        errors.append(float(error.detach()))
    return float(np.mean(errors[-max(1, steps // 10) :])) if errors else 0.0
