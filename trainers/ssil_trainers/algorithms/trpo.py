"""One step of trust region policy optimization (Schulman et al., 2015); knows no environment."""

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

BACKTRACKS = 10
"""How many step lengths the line search tries."""
SHRINKING = 0.8
"""Factor from one tried length to the next."""


@dataclass(frozen=True)
class PolicyStep:
    """What one policy step did.

    Parameters
    ----------
    kl:
        Mean KL divergence from the old policy to the new one, in nats; 0 if no step was taken.
    taken:
        Whether the policy changed. A step is rejected if no tried length improves the objective
        within the KL bound.
    """

    kl: float
    taken: bool


@dataclass(frozen=True)
class TrustRegion:
    """How far a policy step may go, and how its direction is found.

    Parameters
    ----------
    kl:
        Bound on the mean KL divergence of one step, in nats.
    damping:
        Added to the diagonal of the Fisher matrix; larger is safer and slower.
    conjugate_steps:
        Steps of the conjugate gradient that solves for the direction.
    fisher_share:
        Share of the rows that the Fisher matrix is estimated on, above 0 and at most 1.
    entropy:
        λ of the entropy bonus, in units of the advantage per nat.

    Examples
    --------
    >>> _ = torch.manual_seed(0)
    >>> policy = PolicyNetwork(2, 1, hidden=8, log_sigma=-0.7)
    >>> states = torch.randn(64, 2)
    >>> actions = torch.randn(64, 1)
    >>> step = TrustRegion(kl=0.01).step(policy, states, actions, advantages=actions[:, 0])
    >>> step.taken, step.kl < 0.01
    (True, True)
    """

    kl: float = 0.01
    damping: float = 0.1
    conjugate_steps: int = 10
    fisher_share: float = 1.0
    entropy: float = 0.0

    def step(
        self, policy: PolicyNetwork, states: Tensor, actions: Tensor, advantages: Tensor
    ) -> PolicyStep:
        """Raise mean(A · π/π_old) + λH as far as the KL bound allows; changes the policy in place.

        The direction solves F x = g by conjugate gradient, with g the gradient of the objective and
        F the Fisher matrix; its longest length √(2 δ / xᵀF x) is shortened until the objective
        improves within the bound δ.

        Parameters
        ----------
        policy:
            The network to change.
        states:
            Standardized states, (n, d).
        actions:
            Unit actions as they were sampled, (n, k), not clipped.
        advantages:
            How much better than expected each action was, (n,).

        Returns
        -------
        :
            The KL divergence of the step, and whether it was taken.
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
        slope = _flatten(torch.autograd.grad(before, parameters))
        rows = sample_rows(len(states), share=self.fisher_share)
        fisher = fisher_product(policy, states[rows], damping=self.damping)
        direction = conjugate_gradient(fisher, slope, steps=self.conjugate_steps)
        curvature = float(direction @ fisher(direction))
        if not curvature > 0:
            return PolicyStep(0.0, taken=False)
        longest = math.sqrt(2 * self.kl / curvature) * direction
        start = parameters_to_vector(parameters).detach()
        with torch.no_grad():
            for power in range(BACKTRACKS):
                vector_to_parameters(start + SHRINKING**power * longest, parameters)
                after, kl = objective()
                if after > before and kl < self.kl:
                    return PolicyStep(float(kl), taken=True)
            vector_to_parameters(start, parameters)
        return PolicyStep(0.0, taken=False)


def sample_rows(count: int, *, share: float) -> Tensor:
    """Choose a share of the rows at random, but always the same ones, in rising order.

    Rows at a fixed distance would not do: a rollout lists environment after environment, so they
    would all be of the same few environments.

    Parameters
    ----------
    count:
        Number of rows to choose from.
    share:
        Share to choose, above 0 and at most 1; at least one row is chosen.

    Examples
    --------
    >>> rows = sample_rows(8, share=0.5)
    >>> len(rows), bool((rows.diff() > 0).all())
    (4, True)
    """
    order = torch.randperm(count, generator=torch.Generator().manual_seed(0))
    return order[: max(1, round(share * count))].sort().values


def fisher_product(policy: PolicyNetwork, states: Tensor, *, damping: float) -> Product:
    """Return v ↦ (F + damping·1) v without building F.

    F is the Hessian of the mean KL divergence from the policy to itself, which equals the Fisher
    information matrix; a product with it costs two backward passes.

    Parameters
    ----------
    policy:
        The policy, with m parameters in all.
    states:
        Standardized states, (n, d), over which the divergence is averaged.
    damping:
        Added to the diagonal.

    Returns
    -------
    :
        A function from vectors (m,) to vectors (m,).

    Examples
    --------
    >>> policy = PolicyNetwork(2, 1, hidden=4, log_sigma=-0.7)
    >>> vector = torch.ones(sum(p.numel() for p in policy.parameters()))
    >>> product = fisher_product(policy, torch.randn(16, 2), damping=0.1)
    >>> float(vector @ product(vector)) > 0
    True
    """
    parameters = list(policy.parameters())
    now = policy(states)
    kl = now.detach().kl_to(now)
    slope = _flatten(torch.autograd.grad(kl, parameters, create_graph=True))

    def product(vector: Tensor) -> Tensor:
        second = torch.autograd.grad(slope @ vector, parameters, retain_graph=True)
        return _flatten(second) + damping * vector

    return product


def conjugate_gradient(
    product: Product, right: Tensor, *, steps: int, tolerance: float = 1e-10
) -> Tensor:
    """Solve product(x) = right for x, starting from x = 0.

    Parameters
    ----------
    product:
        Multiplies a vector (m,) by a symmetric positive matrix.
    right:
        The right-hand side, (m,).
    steps:
        Most steps to take; m of them solve the system up to rounding.
    tolerance:
        Stop when the squared length of the residual is below it.

    Examples
    --------
    >>> matrix = torch.tensor([[2.0, 1.0], [1.0, 3.0]])
    >>> x = conjugate_gradient(lambda v: matrix @ v, torch.tensor([3.0, 4.0]), steps=2)
    >>> torch.allclose(x, torch.ones(2))
    True
    """
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
        before = square
        square = residual @ residual
        direction = residual + square / before * direction
    return x


def _flatten(parts: Sequence[Tensor]) -> Tensor:
    """Join tensors into one vector."""
    return torch.cat([part.reshape(-1) for part in parts])
