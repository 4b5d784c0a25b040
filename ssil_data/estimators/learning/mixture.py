"""Learning a mixture density network by its likelihood."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, log_softmax, logsumexp

from ssil_data.estimators.learning.descent import descend, network, perceptron, reproducible
from ssil_data.estimators.mdn import MDN
from ssil_data.estimators.perceptron import Perceptron


def learn(
    states: NDArray[np.float32], actions: NDArray[np.float32], settings: MDN, *, seed: int
) -> Perceptron:
    """Return the network of the mixture: state (d) → logits (K), means (K·k), log variances (K·k).

    Minimises −log p(a | s) (Bishop, 1994).
    """
    width = actions.shape[1]
    count = settings.components

    def loss(s: Tensor, a: Tensor) -> Tensor:
        logits, mean, raw = mixture(s).split([count, count * width, count * width], dim=1)
        shape = (-1, count, width)
        variance = raw.reshape(shape).exp() + settings.floor
        distance = (a.unsqueeze(1) - mean.reshape(shape)).square() / variance
        log_density = -(distance + variance.log() + math.log(2 * math.pi)).sum(dim=2) / 2
        return -logsumexp(log_softmax(logits, dim=1) + log_density, dim=1).mean()

    with reproducible(seed):
        mixture = network(states.shape[1], settings.hidden, count * (1 + 2 * width))
        descend(
            loss,
            (states, actions),
            [mixture],
            steps=settings.steps,
            batch=settings.batch,
            rate=settings.rate,
        )
    return perceptron(mixture)
