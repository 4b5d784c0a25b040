"""Batches of which one half is labeled and the other is drawn from unlabeled pairs by weight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ssil_trainers.algorithms.expert_sampler import ExpertSampler


@dataclass(frozen=True, eq=False)
class HalfLabeledSampler:
    """Draws half of every batch from labeled pairs, whatever the weights of unlabeled ones.

    However many unlabeled pairs there are, and however large their weights, what is known to be an
    expert's keeps half of every batch: with enough labels, weights that are wrong do little harm.

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
