"""Learning a variational autoencoder: the evidence lower bound with a decoder of unit variance."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ssil_data.estimators.learning.descent import descend, network, perceptron, reproducible
from ssil_data.estimators.perceptron import Perceptron
from ssil_data.estimators.vae import AutoencoderSettings


def learn(
    inputs: NDArray[np.float32], settings: AutoencoderSettings, *, seed: int
) -> tuple[Perceptron, Perceptron]:
    """Return encoder (d → 2·latent: means, log variances) and decoder (latent → d) of `inputs`.

    Minimises ½‖x − decoder(z)‖² + β KL(N(mean, variance) ‖ N(0, 1)), z drawn from the encoder
    (Kingma and Welling, 2014; β: Higgins et al., 2017).
    """
    width = inputs.shape[1]

    def loss(x: Tensor) -> Tensor:
        mean, log_variance = encoder(x).chunk(2, dim=1)
        z = mean + torch.exp(log_variance / 2) * torch.randn_like(mean)
        divergence = (mean.square() + log_variance.exp() - log_variance - 1).sum(dim=1) / 2
        return ((x - decoder(z)).square().sum(dim=1) / 2 + settings.beta * divergence).mean()

    with reproducible(seed):
        encoder = network(width, settings.hidden, 2 * settings.latent)
        decoder = network(settings.latent, settings.hidden, width)
        descend(
            loss,
            (inputs,),
            [encoder, decoder],
            steps=settings.steps,
            batch=settings.batch,
            rate=settings.rate,
        )
    return perceptron(encoder), perceptron(decoder)
