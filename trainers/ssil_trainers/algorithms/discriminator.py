"""Training the discriminator, which separates the policy's pairs from expert pairs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import softplus

from ssil_trainers.algorithms.expert_sampler import PairSampler
from ssil_trainers.algorithms.networks import Discriminator


@dataclass(frozen=True)
class DiscriminatorUpdate:
    """One iteration's update of the discriminator.

    Parameters
    ----------
    steps:
        Gradient steps per iteration; 0 leaves the discriminator as it is.
    batch:
        Pairs of the policy, and as many of the experts, in one step.
    gradient_penalty:
        Beyond the paper: weight of (‖∇ logit‖ − 1)² between policy and expert pairs; 0 is off.

    Examples
    --------
    >>> _ = torch.manual_seed(0)
    >>> expert = np.full((64, 2), -1, np.float32)
    >>> from ssil_trainers.algorithms.expert_sampler import ExpertSampler
    >>> experts = ExpertSampler(expert, expert[:, :1], np.ones(64, np.float32))
    >>> discriminator = Discriminator(2, 1, hidden=8, spectral=False)
    >>> optimizer = torch.optim.Adam(discriminator.parameters(), lr=1e-2)
    >>> update = DiscriminatorUpdate(steps=50, batch=16)
    >>> pairs = torch.ones(64, 3)
    >>> rng = np.random.default_rng(0)
    >>> update(discriminator, optimizer, pairs=pairs, experts=experts, rng=rng) > 0.9
    True
    >>> float(discriminator(pairs).mean().detach()) > 0  # high for the policy's pairs
    True
    """

    steps: int = 10
    batch: int = 256
    gradient_penalty: float = 0.0

    def __call__(
        self,
        discriminator: Discriminator,
        optimizer: torch.optim.Optimizer,
        *,
        pairs: Tensor,
        experts: PairSampler,
        rng: np.random.Generator,
    ) -> float:
        """Raise E_π[log D] + E_E[log(1 − D)], in place; return how well it separates the two.

        Parameters
        ----------
        discriminator:
            The network to train; D → 1 for the policy's pairs.
        optimizer:
            The optimizer of its parameters.
        pairs:
            The policy's pairs, (n, d + k): standardized states and clipped unit actions.
        experts:
            The expert pairs.
        rng:
            Draws the batches.

        Returns
        -------
        :
            Accuracy before each step, averaged: the share of pairs classified correctly. 1 is
            perfect separation, ½ none. Without steps it is ½.
        """
        accuracies = [] if self.steps else [0.5]
        for _ in range(self.steps):
            rows = torch.from_numpy(rng.integers(len(pairs), size=self.batch))
            policy = pairs[rows]
            expert = torch.cat(experts.sample(self.batch, rng), dim=1)
            logits = discriminator(torch.cat([policy, expert]))
            logit_policy, logit_expert = logits.split(self.batch)
            # −log D of the policy's pairs, −log(1 − D) of the experts': D is the sigmoid.
            loss = softplus(-logit_policy).mean() + softplus(logit_expert).mean()
            if self.gradient_penalty:
                penalty = _gradient_penalty(discriminator, policy, expert, rng)
                loss = loss + self.gradient_penalty * penalty
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            correct = (logit_policy > 0).float().mean() + (logit_expert < 0).float().mean()
            accuracies.append(float(correct) / 2)
        return float(np.mean(accuracies))


def _gradient_penalty(
    discriminator: Discriminator, policy: Tensor, expert: Tensor, rng: np.random.Generator
) -> Tensor:
    """Return the mean (‖∇ logit‖ − 1)² at random points between both (Gulrajani et al., 2017)."""
    share = torch.from_numpy(rng.random((len(policy), 1), dtype=np.float32))
    between = (share * policy + (1 - share) * expert).requires_grad_()
    (slope,) = torch.autograd.grad(discriminator(between).sum(), between, create_graph=True)
    return (slope.norm(dim=1) - 1).square().mean()
