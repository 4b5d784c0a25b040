"""One step of trust region policy optimisation (Schulman et al., 2015); knows no environment."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from ssil_trainers.algorithms.networks import PolicyNetwork

Product = Callable[[Tensor], Tensor]
"""Multiplies a vector by a symmetric positive matrix."""

BACKTRACKS, SHRINKING = 10, 0.8


@dataclass(frozen=True)
class Step:
    """What a step did: the mean KL divergence from the old policy, and if it was taken at all."""

    kl: float
    taken: bool


@dataclass(frozen=True)
class TrustRegion:
    """How far a step may go, and how its direction is found."""

    kl: float = 0.01
    damping: float = 0.1
    conjugate_steps: int = 10
    fisher_share: float = 1.0
    entropy: float = 0.0

    def step(
        self, policy: PolicyNetwork, states: Tensor, actions: Tensor, advantages: Tensor
    ) -> Step:
        """Raise mean(A · π/π_old) + λH as far as the KL bound lets it; changes the policy.

        states (n, d) standardised, actions (n, k) as they were drawn, not clipped, advantages (n,).
        The Fisher matrix is estimated on `fisher_share` of the rows. A step that does not improve
        the objective within the bound after all backtracking is not taken.
        """
        parameters = list(policy.parameters())
        with torch.no_grad():
            old = policy(states)
            old_log_likelihood = old.log_likelihood(actions)

        def objective() -> tuple[Tensor, Tensor]:
            new = policy(states)
            ratio = torch.exp(new.log_likelihood(actions) - old_log_likelihood)
            return (ratio * advantages).mean() + self.entropy * new.entropy(), old.kl_to(new)

        before, _ = objective()
        slope = _flat(torch.autograd.grad(before, parameters))
        rows = some_rows(len(states), share=self.fisher_share)
        fisher = fisher_product(policy, states[rows], damping=self.damping)
        direction = conjugate_gradient(fisher, slope, steps=self.conjugate_steps)
        curvature = float(direction @ fisher(direction))
        if not curvature > 0:
            return Step(0.0, taken=False)
        longest = math.sqrt(2 * self.kl / curvature) * direction
        start = parameters_to_vector(parameters).detach()
        with torch.no_grad():
            for power in range(BACKTRACKS):
                vector_to_parameters(start + SHRINKING**power * longest, parameters)
                after, kl = objective()
                if after > before and kl < self.kl:
                    return Step(float(kl), taken=True)
            vector_to_parameters(start, parameters)
        return Step(0.0, taken=False)


def some_rows(count: int, *, share: float) -> Tensor:
    """Return a share of the rows, rising, always the same ones.

    They are drawn: rows at a fixed distance would all be of the same few environments.
    """
    drawn = torch.randperm(count, generator=torch.Generator().manual_seed(0))
    return drawn[: max(1, round(share * count))].sort().values


def fisher_product(policy: PolicyNetwork, states: Tensor, *, damping: float) -> Product:
    """Return v ↦ (F + damping·1)v, F the Hessian of the mean KL divergence at the policy."""
    parameters = list(policy.parameters())
    now = policy(states)
    kl = now.detach().kl_to(now)
    slope = _flat(torch.autograd.grad(kl, parameters, create_graph=True))

    def product(vector: Tensor) -> Tensor:
        again = torch.autograd.grad(slope @ vector, parameters, retain_graph=True)
        return _flat(again) + damping * vector

    return product


def conjugate_gradient(
    product: Product, right: Tensor, *, steps: int, tolerance: float = 1e-10
) -> Tensor:
    """Solve product(x) = right from x = 0; stops when the squared residual is below tolerance."""
    x = torch.zeros_like(right)
    residual = right.clone()
    direction = right.clone()
    square = residual @ residual
    for _ in range(steps):
        if square < tolerance:
            break
        image = product(direction)
        length = square / (direction @ image)
        x = x + length * direction
        residual = residual - length * image
        square, before = residual @ residual, square
        direction = residual + square / before * direction
    return x


def _flat(parts: Sequence[Tensor]) -> Tensor:
    return torch.cat([part.reshape(-1) for part in parts])
