"""Teaching the discriminator to tell the policy's pairs from the experts'."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import softplus

from ssil_trainers.algorithms.expert_sampler import ExpertSampler
from ssil_trainers.algorithms.networks import Discriminator


@dataclass(frozen=True)
class DiscriminatorUpdate:
    """How many steps per iteration, on how many pairs of either kind, with what penalty."""

    steps: int = 10
    batch: int = 256
    gradient_penalty: float = 0.0

    def __call__(
        self,
        discriminator: Discriminator,
        optimiser: torch.optim.Optimizer,
        *,
        pairs: Tensor,
        experts: ExpertSampler,
        rng: np.random.Generator,
    ) -> float:
        """Raise E_π[log D] + E_E[log(1 − D)]; return the share of pairs told rightly before.

        pairs (n, d + k) are the policy's. Without steps nothing is learned, and ½ is returned.
        """
        right = [0.5] if not self.steps else []
        for _ in range(self.steps):
            drawn = pairs[torch.from_numpy(rng.integers(len(pairs), size=self.batch))]
            expert = torch.cat(experts.draw(self.batch, rng), dim=1)
            logit_policy, logit_expert = discriminator(torch.cat([drawn, expert])).split(self.batch)
            loss = softplus(-logit_policy).mean() + softplus(logit_expert).mean()
            if self.gradient_penalty:
                loss = loss + self.gradient_penalty * _steepness(discriminator, drawn, expert, rng)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            told = (logit_policy > 0).float().mean() + (logit_expert < 0).float().mean()
            right.append(float(told) / 2)
        return float(np.mean(right))


def _steepness(
    discriminator: Discriminator, policy: Tensor, expert: Tensor, rng: np.random.Generator
) -> Tensor:
    """Return the mean (‖∇ logit‖ − 1)² at points between both (Gulrajani et al., 2017)."""
    share = torch.from_numpy(rng.random((len(policy), 1), dtype=np.float32))
    between = (share * policy + (1 - share) * expert).requires_grad_()
    (slope,) = torch.autograd.grad(discriminator(between).sum(), between, create_graph=True)
    return (slope.norm(dim=1) - 1).square().mean()
