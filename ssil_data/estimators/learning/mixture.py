"""Learning a mixture density network by its likelihood."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, log_softmax, logsumexp

from ssil_data.estimators.learning.descent import descend, network, perceptron, reproducible
from ssil_data.estimators.perceptron import Perceptron


def learn(
    states: NDArray[np.float32],
    actions: NDArray[np.float32],
    *,
    components: int,
    hidden: int,
    floor: float,
    steps: int,
    batch: int,
    rate: float,
    seed: int,
) -> Perceptron:
    """Train the network of a mixture of normal actions; minimizes −log p(a | s) (Bishop, 1994).

    Parameters
    ----------
    states, actions
        Standardized pairs, (n, d) and (n, k).
    components
        Normal distributions in the mixture, K.
    hidden
        Width of the hidden layer.
    floor
        Least variance of a component, added to exp(log variance).
    steps, batch, rate
        Of Adam, see `descend`.
    seed
        Sets the first weights and the batches.

    Returns
    -------
    Perceptron
        The network: state (d) → logits (K), means (K·k), log variances (K·k).
    """
    width = actions.shape[1]
    count = components

    def loss(s: Tensor, a: Tensor) -> Tensor:
        logits, mean, raw = mixture(s).split([count, count * width, count * width], dim=1)
        shape = (-1, count, width)
        variance = raw.reshape(shape).exp() + floor
        distance = (a.unsqueeze(1) - mean.reshape(shape)).square() / variance
        log_density = -(distance + variance.log() + math.log(2 * math.pi)).sum(dim=2) / 2
        return -logsumexp(log_softmax(logits, dim=1) + log_density, dim=1).mean()

    with reproducible(seed):
        mixture = network(states.shape[1], hidden, count * (1 + 2 * width))
        descend(loss, (states, actions), [mixture], steps=steps, batch=batch, rate=rate)
    return perceptron(mixture)
