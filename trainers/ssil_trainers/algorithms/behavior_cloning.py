"""Behavior cloning: the policy's mean action is regressed on the actions of expert pairs."""

from __future__ import annotations

import numpy as np
import torch

from ssil_trainers.algorithms.expert_sampler import PairSampler
from ssil_trainers.algorithms.networks import PolicyNetwork


def clone(
    policy: PolicyNetwork,
    experts: PairSampler,
    *,
    steps: int,
    batch: int,
    rate: float,
    weight_decay: float = 0.0,
    rng: np.random.Generator,
) -> float:
    """Fit the policy's mean to the expert actions, in place, and return the error that is left.

    AdamW minimizes the squared error with a cosine schedule. The sampler decides what is cloned:
    labeled pairs alone, all pairs, or labeled ones and those unlabeled ones that are surely the
    expert's, half of every batch each. log σ does not change, so a policy that is trained further
    explores as before.

    Parameters
    ----------
    policy:
        The network whose mean is changed.
    experts:
        The pairs to imitate, with their weights.
    steps:
        Number of gradient steps; 0 leaves the policy as it is.
    batch:
        Pairs in one step.
    rate:
        Step size at the start; it falls to zero as a cosine.
    weight_decay:
        Every step also multiplies weights and biases by 1 − step size × this; 0 is plain Adam.
    rng:
        Draws the batches.

    Returns
    -------
    :
        Mean squared error of unit actions over the last tenth of the steps, lower is better; 0
        without steps.

    Source
    ------
    Loshchilov, Hutter: Decoupled weight decay regularization, 2019, algorithm 2.

    Examples
    --------
    >>> states = np.linspace(-1, 1, 50, dtype=np.float32)[:, None]
    >>> from ssil_trainers.algorithms.expert_sampler import ExpertSampler
    >>> experts = ExpertSampler(states, states / 2, np.ones(50, np.float32))
    >>> policy = PolicyNetwork(1, 1, hidden=8, log_sigma=-0.7)
    >>> rng = np.random.default_rng(0)
    >>> clone(policy, experts, steps=200, batch=32, rate=1e-2, rng=rng) < 0.01
    True
    """
    optimizer = torch.optim.AdamW(
        policy.mean.parameters(), lr=rate, weight_decay=weight_decay, fused=True
    )
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, max(1, steps))
    errors = []
    for _ in range(steps):
        states, actions = experts.sample(batch, rng)
        error = (policy.mean(states) - actions).square().mean()
        optimizer.zero_grad()
        error.backward()
        optimizer.step()
        schedule.step()
        errors.append(float(error.detach()))
    if not errors:
        return 0.0
    return float(np.mean(errors[-max(1, steps // 10) :]))
