"""The networks in torch, each with two hidden tanh layers: policy, critics and discriminator."""

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
    """Build a network with two hidden tanh layers and orthogonal initial weights.

    Parameters
    ----------
    inputs:
        Width of the input.
    hidden:
        Units in each hidden layer.
    outputs:
        Width of the output.
    last:
        Factor of the last layer's initial weights. With 0 the network begins as the constant 0.

    Examples
    --------
    >>> network = perceptron(3, 8, 2, last=0.0)
    >>> network(torch.ones(5, 3)).shape, bool(network(torch.ones(5, 3)).any())
    (torch.Size([5, 2]), False)
    """
    widths = (inputs, hidden, hidden, outputs)
    linears = [nn.Linear(width, next_width) for width, next_width in pairwise(widths)]
    for linear, gain in zip(linears, (math.sqrt(2), math.sqrt(2), last), strict=True):
        nn.init.orthogonal_(linear.weight, gain)
        nn.init.zeros_(linear.bias)
    inner, middle, outer = linears
    return nn.Sequential(inner, nn.Tanh(), middle, nn.Tanh(), outer)


@dataclass(frozen=True, eq=False)
class Gaussian:
    """Independent normal distributions over k unit actions, one for each of n states.

    Parameters
    ----------
    mean:
        Means, (n, k).
    log_sigma:
        Logarithms of the standard deviations, (k,), shared by all states.

    Examples
    --------
    >>> gaussian = Gaussian(torch.zeros(1, 2), torch.zeros(2))
    >>> round(float(gaussian.log_likelihood(torch.zeros(1, 2))), 3)  # −log 2π
    -1.838
    >>> float(gaussian.kl_to(Gaussian(torch.ones(1, 2), torch.zeros(2))))
    1.0
    """

    mean: Tensor
    log_sigma: Tensor

    def log_likelihood(self, actions: Tensor) -> Tensor:
        """Return the log-likelihood of unit actions (n, k) in each state, (n,), in nats.

        Parameters
        ----------
        actions:
            Unit actions, (n, k), not clipped.
        """
        away = (actions - self.mean) * torch.exp(-self.log_sigma)
        return -(0.5 * away.square() + self.log_sigma + 0.5 * math.log(2 * math.pi)).sum(-1)

    def kl_to(self, other: Gaussian) -> Tensor:
        """Return KL(self ‖ other) in nats, averaged over the n states, a scalar.

        Parameters
        ----------
        other:
            The distributions to compare with, of the same shape.
        """
        ratio = torch.exp(2 * (self.log_sigma - other.log_sigma))
        away = (self.mean - other.mean) * torch.exp(-other.log_sigma)
        each = 0.5 * (ratio + away.square() - 1) + other.log_sigma - self.log_sigma
        return each.sum(-1).mean()

    def entropy(self) -> Tensor:
        """Return the entropy in nats, a scalar: it is the same in every state."""
        return (self.log_sigma + 0.5 * math.log(2 * math.pi * math.e)).sum()

    def detach(self) -> Gaussian:
        """Return the same distributions, cut off from the gradient."""
        return Gaussian(self.mean.detach(), self.log_sigma.detach())


class PolicyNetwork(nn.Module):
    """The Gaussian policy: its mean depends on the standardized state, log σ does not.

    Parameters
    ----------
    states:
        Width d of a state.
    actions:
        Width k of an action.
    hidden:
        Units in each hidden layer.
    log_sigma:
        Logarithm of the initial standard deviation, in half-widths of the action box.

    Examples
    --------
    >>> policy = PolicyNetwork(3, 2, hidden=8, log_sigma=-0.7)
    >>> policy(torch.zeros(5, 3)).mean.shape
    torch.Size([5, 2])
    >>> [weight.shape for weight, bias in policy.layers()]
    [(3, 8), (8, 8), (8, 2)]
    """

    def __init__(self, states: int, actions: int, hidden: int, log_sigma: float) -> None:
        """Initialize the mean close to the middle of the action box."""
        super().__init__()
        self.mean = perceptron(states, hidden, actions, last=0.01)
        self.log_sigma = nn.Parameter(torch.full((actions,), log_sigma))

    def forward(self, states: Tensor) -> Gaussian:
        """Map standardized states (n, d) to distributions over unit actions.

        Parameters
        ----------
        states:
            Standardized states, (n, d).
        """
        return Gaussian(self.mean(states), self.log_sigma)

    def layers(self) -> tuple[Layer, ...]:
        """Return copies of the mean's weights (in, out) and biases (out,), layer by layer."""
        linears = [layer for layer in self.mean if isinstance(layer, nn.Linear)]
        return tuple((_copy(each.weight.T), _copy(each.bias)) for each in linears)


class Critics(nn.Module):
    """The critics V_D and V_C, of the discriminator's reward and of the state reward.

    Networks of the same shape, computed together in one batched product; all begin as 0. Their
    outputs are in units of 1/(1 − γ), the return of a reward of 1 at every step, so that one step
    size suits every discount. A third critic, where there is one, begins as V_C does: of a centered
    state reward, it learns the value before centering.

    Parameters
    ----------
    states:
        Width d of a state.
    hidden:
        Units in each hidden layer.
    discount:
        γ, from 0 to 1.
    uncentered:
        Whether there is the third.

    Examples
    --------
    >>> critics = Critics(3, hidden=8, discount=0.9)
    >>> critics(torch.ones(5, 3)).shape, bool(critics(torch.ones(5, 3)).any())
    (torch.Size([2, 5]), False)
    """

    def __init__(
        self, states: int, hidden: int, discount: float, *, uncentered: bool = False
    ) -> None:
        """Initialize the networks."""
        super().__init__()
        linears = [
            [layer for layer in net if isinstance(layer, nn.Linear)]
            for net in (perceptron(states, hidden, 1, last=0.0) for _ in range(2))
        ]
        if uncentered:
            linears.append(linears[1])
        layers = list(zip(*linears, strict=True))
        self.weights = nn.ParameterList([_stack(*(one.weight.T for one in p)) for p in layers])
        self.biases = nn.ParameterList([_stack(*(one.bias[None] for one in p)) for p in layers])
        self.count = len(linears)
        self.unit = 1 / (1 - discount) if discount < 1 else 1.0

    def forward(self, states: Tensor) -> Tensor:
        """Map standardized states (n, d) to values (2 or 3, n): V_D, V_C, and the third if any.

        Parameters
        ----------
        states:
            Standardized states, (n, d).
        """
        x = states.expand(self.count, -1, -1)
        *inner, last = zip(self.biases, self.weights, strict=True)
        for bias, weight in inner:
            x = torch.tanh(torch.baddbmm(bias, x, weight))
        return torch.baddbmm(last[0], x, last[1])[..., 0] * self.unit


class Discriminator(nn.Module):
    """The discriminator D = sigmoid(logit): near 1 for the policy's pairs, near 0 for expert pairs.

    Without `spectral` it begins as D = ½ everywhere.

    Parameters
    ----------
    states:
        Width d of a state.
    actions:
        Width k of an action.
    hidden:
        Units in each hidden layer.
    spectral:
        Whether every layer is kept at spectral norm 1.

    Examples
    --------
    >>> discriminator = Discriminator(3, 2, hidden=8, spectral=False)
    >>> round(discriminator.reward(torch.zeros(1, 5)).item(), 4)  # −log ½
    0.6931
    """

    def __init__(self, states: int, actions: int, hidden: int, *, spectral: bool) -> None:
        """Initialize the network."""
        super().__init__()
        self.net = perceptron(states + actions, hidden, 1, last=1.0 if spectral else 0.0)
        if spectral:
            for layer in self.net:
                if isinstance(layer, nn.Linear):
                    spectral_norm(layer)

    def forward(self, pairs: Tensor) -> Tensor:
        """Map pairs (n, d + k) to logits (n,), which are high where a pair looks like the policy's.

        A pair is a standardized state followed by a unit action.

        Parameters
        ----------
        pairs:
            Pairs, (n, d + k).
        """
        return self.net(pairs)[:, 0]

    def reward(self, pairs: Tensor) -> Tensor:
        """Return −log D (n,), at least 0: the higher, the more a pair looks like the experts'.

        Parameters
        ----------
        pairs:
            Pairs, (n, d + k).
        """
        return softplus(-self(pairs))


def _stack(*tensors: Tensor) -> nn.Parameter:
    """Stack tensors of one shape into a parameter (count, ...)."""
    return nn.Parameter(torch.stack([tensor.detach() for tensor in tensors]).contiguous())


def _copy(tensor: Tensor) -> NDArray[np.float32]:
    """Copy a tensor into an array."""
    return tensor.detach().numpy().copy(order="C")
