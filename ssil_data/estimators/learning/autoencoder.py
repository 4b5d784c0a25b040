"""Learning a variational autoencoder: the evidence lower bound with a decoder of unit variance."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ssil_data.estimators.learning.descent import descend, network, perceptron, reproducible
from ssil_data.estimators.perceptron import Perceptron


def learn(
    inputs: NDArray[np.float32],
    *,
    latent: int,
    hidden: int,
    beta: float,
    steps: int,
    batch: int,
    rate: float,
    seed: int,
) -> tuple[Perceptron, Perceptron]:
    """Train an encoder and a decoder of rows.

    Minimizes ½‖x − decoder(z)‖² + β KL(N(mean, variance) ‖ N(0, 1)), z drawn from the encoder
    (Kingma and Welling, 2014; β: Higgins et al., 2017).

    Parameters
    ----------
    inputs
        Standardized rows (n, d).
    latent, hidden
        Widths of the latent space and of the hidden layers.
    beta
        Weight of the KL term.
    steps, batch, rate
        Of Adam, see `descend`.
    seed
        Sets the first weights, the batches and z.

    Returns
    -------
    tuple of Perceptron
        The encoder (d → 2·latent: means, log variances) and the decoder (latent → d).
    """
    width = inputs.shape[1]

    def loss(x: Tensor) -> Tensor:
        mean, log_variance = encoder(x).chunk(2, dim=1)
        z = mean + torch.exp(log_variance / 2) * torch.randn_like(mean)
        divergence = (mean.square() + log_variance.exp() - log_variance - 1).sum(dim=1) / 2
        return ((x - decoder(z)).square().sum(dim=1) / 2 + beta * divergence).mean()

    with reproducible(seed):
        encoder = network(width, hidden, 2 * latent)
        decoder = network(latent, hidden, width)
        descend(loss, (inputs,), [encoder, decoder], steps=steps, batch=batch, rate=rate)
    return perceptron(encoder), perceptron(decoder)
