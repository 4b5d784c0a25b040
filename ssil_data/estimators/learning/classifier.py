"""Learning a classifier of labeled against unlabeled pairs, some of which are the expert's."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import softplus

from ssil_data.estimators.learning.adam import Adam
from ssil_data.estimators.learning.descent import network, perceptron, reproducible
from ssil_data.estimators.perceptron import Perceptron


def learn(
    labeled: NDArray[np.float32],
    unlabeled: NDArray[np.float32],
    *,
    share: float,
    hidden: int,
    gradient_penalty: float,
    steps: int,
    batch: int,
    rate: float,
    seed: int,
) -> Perceptron:
    """Train a network whose logit is high for the expert's pairs.

    Minimizes the non-negative risk π E_L ℓ(f) + max(0, E_U ℓ(−f) − π E_L ℓ(−f)), ℓ the logistic
    loss; where the second term is negative, its sign is turned (Kiryo et al., 2017).

    Parameters
    ----------
    labeled, unlabeled
        Standardized pairs, (n, d + k) and (m, d + k).
    share
        π, the assumed share of the expert's among the unlabeled pairs.
    hidden
        Width of the hidden layer.
    gradient_penalty
        Weight of the penalty on slopes beyond 1 between both.
    steps, batch, rate
        Of Adam, whose rate falls to zero as a cosine; a batch is of as many pairs of each.
    seed
        Sets the first weights and the batches.

    Returns
    -------
    Perceptron
        The network: pair (d + k) → logit (1).
    """
    ours = torch.from_numpy(labeled)
    others = torch.from_numpy(unlabeled)
    with reproducible(seed):
        classifier = network(labeled.shape[1], hidden, 1)
        adam = Adam(classifier.parameters(), steps=steps, rate=rate)
        for _ in range(steps):
            expert = ours[torch.randint(len(ours), (batch,))]
            other = others[torch.randint(len(others), (batch,))]
            high, low = classifier(torch.cat([expert, other])).squeeze(1).split(batch)
            loss = _non_negative_risk(high, low, share)
            mix = torch.rand(batch, 1)
            slopes = _slopes(classifier, mix * expert + (1 - mix) * other)
            penalty = (slopes - 1).clamp(min=0).square().mean()
            adam.step(loss + gradient_penalty * penalty)
    return perceptron(classifier)


def _non_negative_risk(high: Tensor, low: Tensor, share: float) -> Tensor:
    """Return the risk of logits of labeled pairs (`high`) and of unlabeled ones (`low`)."""
    of_expert = share * softplus(-high).mean()
    of_others = softplus(low).mean() - share * softplus(high).mean()
    return of_expert + of_others.abs()


def _slopes(classifier: torch.nn.Module, pairs: Tensor) -> Tensor:
    """Return the norm of the logit's gradient at some pairs."""
    pairs = pairs.requires_grad_()
    (slope,) = torch.autograd.grad(classifier(pairs).sum(), pairs, create_graph=True)
    return slope.norm(dim=1)
