"""What is imitated: expert pairs as the networks see them, drawn by weight."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ssil_data.errors import InvalidInputError


@dataclass(frozen=True, eq=False)
class ExpertSampler:
    """n pairs of standardised state (n, d) and unit action (n, k), each with a weight (n,) ≥ 0.

    A pair is drawn with a probability proportional to its weight.
    """

    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    weight: NDArray[np.float32]

    def __post_init__(self) -> None:
        """Refuse unequal lengths, negative weights and experts that are nobody."""
        lengths = len(self.states), len(self.actions), len(self.weight)
        if len(set(lengths)) > 1:
            raise InvalidInputError(f"experts: expected equal lengths, found {lengths}")
        if not (self.weight >= 0).all() or not self.weight.any():
            raise InvalidInputError("experts: expected weights of at least 0, one above it")

    def draw(self, count: int, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """Draw states (count, d) and actions (count, k) with replacement."""
        rows = np.searchsorted(self._cumulative, rng.random(count), side="right")
        return torch.from_numpy(self.states[rows]), torch.from_numpy(self.actions[rows])

    @cached_property
    def _cumulative(self) -> NDArray[np.float64]:
        """Rise from above 0 to exactly 1 at the last pair of positive weight."""
        total = np.cumsum(self.weight, dtype=np.float64)
        return total / total[-1]
