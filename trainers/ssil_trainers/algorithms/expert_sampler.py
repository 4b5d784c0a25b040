"""The expert pairs of a method, drawn at random by their weights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ssil_data.errors import InvalidInputError


class PairSampler(Protocol):
    """Draws batches of expert pairs."""

    def sample(self, count: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """Draw pairs with replacement.

        Parameters
        ----------
        count:
            Number of pairs.
        rng:
            Source of randomness.

        Returns
        -------
        :
            States (count, d) and actions (count, k), row by row of the same pair.
        """
        ...


@dataclass(frozen=True, eq=False)
class ExpertSampler:
    """Draws expert pairs with probabilities proportional to their weights.

    Parameters
    ----------
    states:
        Standardized states, (n, d).
    actions:
        Unit actions, (n, k): each component from −1 to 1.
    weights:
        How much each pair is imitated, (n,), at least 0; a pair of weight 2 is drawn twice as often
        as one of weight 1, and a pair of weight 0 never.

    Raises
    ------
    InvalidInputError
        For unequal lengths, negative weights, or all-zero weights.

    Examples
    --------
    >>> states = np.array([[0.0], [1.0], [2.0]], np.float32)
    >>> experts = ExpertSampler(states, -states, np.array([0, 1, 0], np.float32))
    >>> states, actions = experts.sample(3, np.random.default_rng(0))
    >>> states.ravel().tolist(), actions.ravel().tolist()
    ([1.0, 1.0, 1.0], [-1.0, -1.0, -1.0])
    """

    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    weights: NDArray[np.float32]

    def __post_init__(self) -> None:
        """Refuse unequal lengths, negative weights and all-zero weights."""
        lengths = (len(self.states), len(self.actions), len(self.weights))
        if len(set(lengths)) > 1:
            raise InvalidInputError(
                f"experts: states, actions and weights differ in length: {lengths}"
            )
        if not (self.weights >= 0).all():
            raise InvalidInputError(
                f"experts: weights must be at least 0, the smallest is {self.weights.min():g}"
            )
        if not self.weights.any():
            raise InvalidInputError("experts: all weights are 0, so no pair can be drawn")

    def sample(self, count: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """Draw pairs with replacement.

        Parameters
        ----------
        count:
            Number of pairs.
        rng:
            Source of randomness.

        Returns
        -------
        :
            States (count, d) and actions (count, k), row by row of the same pair.
        """
        rows = np.searchsorted(self._cumulative, rng.random(count), side="right")
        return torch.from_numpy(self.states[rows]), torch.from_numpy(self.actions[rows])

    @cached_property
    def _cumulative(self) -> NDArray[np.float64]:
        """Cumulative weights as shares: exactly 1 at the last pair of positive weight."""
        total = np.cumsum(self.weights, dtype=np.float64)
        return total / total[-1]
