"""Batches of labeled pairs and of unlabeled ones by weight: half and half, if there are enough."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ssil_trainers.algorithms.expert_sampler import ExpertSampler


def share_of_unlabeled(labeled: int, weights: NDArray[np.floating]) -> float:
    """Return which part of a batch by weight is unlabeled: a half, or less where that is too much.

    No pair of unknown quality counts more than one that is known to be an expert's. The heaviest
    unlabeled pair counts as a labeled one at most, and the others by their weights, so that n
    unlabeled pairs of equal weight and L labeled ones give min(1/2, n / (n + L)).

    Parameters
    ----------
    labeled:
        Number of labeled pairs, at least one.
    weights:
        Of the unlabeled pairs, (n,), at least 0.

    Returns
    -------
    :
        From 0, where no weight is above 0, to 1/2.

    Examples
    --------
    >>> share_of_unlabeled(3, np.ones(9)), share_of_unlabeled(3, np.ones(1))
    (0.5, 0.25)
    """
    count = float((weights / weights.max()).sum(dtype=np.float64)) if weights.any() else 0.0
    return 0.5 if count >= labeled else count / (count + labeled)


@dataclass(frozen=True, eq=False)
class HalfLabeledSampler:
    """Draws half of every batch from labeled pairs, whatever the weights of unlabeled ones.

    However many unlabeled pairs there are, and however large their weights, what is known to be an
    expert's keeps half of every batch: with enough labels, weights that are wrong do little harm.
    Where unlabeled pairs are too few for the other half, `share_of_unlabeled` says for how much
    they are enough.

    Parameters
    ----------
    labeled:
        The labeled pairs, of equal weight.
    unlabeled:
        The unlabeled pairs, with their weights.

    Examples
    --------
    >>> states = np.array([[0.0], [1.0], [2.0]], np.float32)
    >>> labeled = ExpertSampler(states[:1], states[:1], np.ones(1, np.float32))
    >>> unlabeled = ExpertSampler(states[1:], states[1:], np.array([1, 0], np.float32))
    >>> states, actions = HalfLabeledSampler(labeled, unlabeled).sample(5, np.random.default_rng(0))
    >>> states.ravel().tolist()
    [0.0, 0.0, 0.0, 1.0, 1.0]
    """

    labeled: ExpertSampler
    unlabeled: ExpertSampler

    def sample(self, count: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """Draw pairs with replacement, the labeled ones first.

        Parameters
        ----------
        count:
            Number of pairs; of an odd number, the larger part is labeled.
        rng:
            Source of randomness.

        Returns
        -------
        :
            States (count, d) and actions (count, k), row by row of the same pair.
        """
        half = count // 2
        labeled_states, labeled_actions = self.labeled.sample(count - half, rng)
        states, actions = self.unlabeled.sample(half, rng)
        return torch.cat([labeled_states, states]), torch.cat([labeled_actions, actions])
