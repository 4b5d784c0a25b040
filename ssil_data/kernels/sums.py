"""The sums that make an LCoR answer; sums over shards of a store add up to the store's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Sums:
    """Σ l_j w_j, Σ w_j and Σ w_j² with w_j = k_j / exp(log_scale), each (m,) float64.

    `log_scale` is the largest log k_j of each query, so that the nearest state weighs 1 and no
    sum underflows. `nearest` (m, c) are the rows of the c states that weigh most, with their
    weights w_j in `nearest_weight`, heaviest first.
    """

    numerator: NDArray[np.float64]
    denominator: NDArray[np.float64]
    squares: NDArray[np.float64]
    log_scale: NDArray[np.float64]
    nearest: NDArray[np.int64]
    nearest_weight: NDArray[np.float64]

    @property
    def values(self) -> NDArray[np.float64]:
        """LCoR, (m,)."""
        return self.numerator / self.denominator

    @property
    def effective_sample_size(self) -> NDArray[np.float64]:
        """(Σ w)² / Σ w², (m,): how many states the answer rests on."""
        return self.denominator**2 / self.squares

    @classmethod
    def empty(cls, contributors: int) -> Sums:
        """Return the sums of no queries."""
        nearest = np.empty((0, contributors))
        return cls(*np.empty((4, 0)), nearest=nearest.astype(np.int64), nearest_weight=nearest)

    @classmethod
    def join(cls, parts: Sequence[Sums]) -> Sums:
        """Return the sums of all queries of some parts, at least one, one part after the other."""
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def take(self, rows: NDArray[np.int64]) -> Sums:
        """Return the sums of the queries `rows`, in their order."""
        return Sums(*(getattr(self, field.name)[rows] for field in fields(self)))

    def __add__(self, other: Sums) -> Sums:
        """Join the sums of two shards; rows of `nearest` must be numbered over both."""
        scale = np.maximum(self.log_scale, other.log_scale)
        ours, theirs = np.exp(self.log_scale - scale), np.exp(other.log_scale - scale)
        rows = np.concatenate([self.nearest, other.nearest], axis=1)
        weights = np.concatenate(
            [self.nearest_weight * ours[:, None], other.nearest_weight * theirs[:, None]], axis=1
        )
        count = max(self.nearest.shape[1], other.nearest.shape[1])
        order = np.argsort(-weights, axis=1, kind="stable")[:, :count]
        return Sums(
            numerator=self.numerator * ours + other.numerator * theirs,
            denominator=self.denominator * ours + other.denominator * theirs,
            squares=self.squares * ours**2 + other.squares * theirs**2,
            log_scale=scale,
            nearest=np.take_along_axis(rows, order, axis=1),
            nearest_weight=np.take_along_axis(weights, order, axis=1),
        )
