"""The networks of the loop in torch: two hidden tanh layers each; they know no environment."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import softplus
from torch.nn.utils.parametrizations import spectral_norm

from ssil_trainers.algorithms.policy import Layer


def perceptron(inputs: int, hidden: int, outputs: int, *, last: float) -> nn.Sequential:
    """Return a network with orthogonal weights; those of the last layer are multiplied by `last`.

    With `last` 0 it begins as the constant 0, and nothing but its gradient moves it from there.
    """
    widths = (inputs, hidden, hidden, outputs)
    linears = [nn.Linear(one, next) for one, next in pairwise(widths)]
    for linear, gain in zip(linears, (math.sqrt(2), math.sqrt(2), last), strict=True):
        nn.init.orthogonal_(linear.weight, gain)
        nn.init.zeros_(linear.bias)
    inner, middle, outer = linears
    return nn.Sequential(inner, nn.Tanh(), middle, nn.Tanh(), outer)


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Independent normal distributions over k unit actions: mean (n, k) and log σ (k,)."""

    mean: Tensor
    log_sigma: Tensor

    def log_likelihood(self, actions: Tensor) -> Tensor:
        """Return log p of actions (n, k), (n,)."""
        away = (actions - self.mean) * torch.exp(-self.log_sigma)
        return -(0.5 * away.square() + self.log_sigma + 0.5 * math.log(2 * math.pi)).sum(-1)

    def kl_to(self, other: Gaussian) -> Tensor:
        """Return the mean of KL(self ‖ other) over the rows, a number."""
        ratio = torch.exp(2 * (self.log_sigma - other.log_sigma))
        away = (self.mean - other.mean) * torch.exp(-other.log_sigma)
        each = 0.5 * (ratio + away.square() - 1) + other.log_sigma - self.log_sigma
        return each.sum(-1).mean()

    def entropy(self) -> Tensor:
        """Return the entropy in nats, a number: it does not depend on the state."""
        return (self.log_sigma + 0.5 * math.log(2 * math.pi * math.e)).sum()

    def detach(self) -> Gaussian:
        """Return the same distribution as a constant."""
        return Gaussian(self.mean.detach(), self.log_sigma.detach())


class PolicyNetwork(nn.Module):
    """A Gaussian over unit actions whose mean follows the standardised state, log σ does not."""

    def __init__(self, states: int, actions: int, hidden: int, log_sigma: float) -> None:
        """Begin near the middle of the action box with deviation e^`log_sigma`."""
        super().__init__()
        self.mean = perceptron(states, hidden, actions, last=0.01)
        self.log_sigma = nn.Parameter(torch.full((actions,), log_sigma))

    def forward(self, states: Tensor) -> Gaussian:
        """Map standardised states (n, d) to distributions."""
        return Gaussian(self.mean(states), self.log_sigma)

    def layers(self) -> tuple[Layer, ...]:
        """Return copies of the weights (in, out) and biases of the mean."""
        linears = [layer for layer in self.mean if isinstance(layer, nn.Linear)]
        return tuple((_copy(each.weight.T), _copy(each.bias)) for each in linears)


class TwoCritics(nn.Module):
    """V_D and V_C: two networks of one shape, asked in one product; both begin as 0.

    They learn values in units of 1/(1 − γ), the return of reward 1 for ever, so that one step size
    suits every discount.
    """

    def __init__(self, states: int, hidden: int, discount: float) -> None:
        """Make both networks."""
        super().__init__()
        linears = [
            [layer for layer in net if isinstance(layer, nn.Linear)]
            for net in (perceptron(states, hidden, 1, last=0.0) for _ in range(2))
        ]
        pairs = list(zip(*linears, strict=True))
        self.weights = nn.ParameterList([_stack(*(one.weight.T for one in p)) for p in pairs])
        self.biases = nn.ParameterList([_stack(*(one.bias[None] for one in p)) for p in pairs])
        self.unit = 1 / (1 - discount) if discount < 1 else 1.0

    def forward(self, states: Tensor) -> Tensor:
        """Map standardised states (n, d) to values (2, n): V_D, V_C."""
        x = states.expand(2, -1, -1)
        *inner, last = zip(self.biases, self.weights, strict=True)
        for bias, weight in inner:
            x = torch.tanh(torch.baddbmm(bias, x, weight))
        return torch.baddbmm(last[0], x, last[1])[..., 0] * self.unit


class Discriminator(nn.Module):
    """Tells the policy's pairs from the experts': D = σ(logit), D → 1 for the policy.

    It begins as D = ½ everywhere.
    """

    def __init__(self, states: int, actions: int, hidden: int, *, spectral: bool) -> None:
        """Make the network; with `spectral` every layer has spectral norm 1."""
        super().__init__()
        self.net = perceptron(states + actions, hidden, 1, last=1.0 if spectral else 0.0)
        if spectral:
            for layer in self.net:
                if isinstance(layer, nn.Linear):
                    spectral_norm(layer)

    def forward(self, pairs: Tensor) -> Tensor:
        """Map pairs (n, d + k) of standardised state and unit action to `logit_policy_is_high`."""
        return self.net(pairs)[:, 0]

    def reward(self, pairs: Tensor) -> Tensor:
        """Return −log D (n,), at least 0: the more the experts' a pair looks, the more."""
        return softplus(-self(pairs))


def _stack(first: Tensor, second: Tensor) -> nn.Parameter:
    return nn.Parameter(torch.stack([first.detach(), second.detach()]).contiguous())


def _copy(tensor: Tensor) -> NDArray[np.float32]:
    return tensor.detach().numpy().copy(order="C")
