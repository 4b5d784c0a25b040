"""The sums over references of which LCoR is the ratio; sums over shards of a store add up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Sums:
    """Σ l_j w_j, Σ w_j and Σ w_j² over all references j, for each of m queries; float64.

    The weight is w_j = k_j / exp(log_scale), where log_scale (m,) is the largest log k_j of the
    query: the nearest reference weighs 1, and no sum underflows. nearest (m, c) are the rows of the
    c references that weigh most, heaviest first, and nearest_weight (m, c) their weights.

    Source: equation 5 of Lee et al.; see `formulas`.
    """

    numerator: NDArray[np.float64]
    denominator: NDArray[np.float64]
    squares: NDArray[np.float64]
    log_scale: NDArray[np.float64]
    nearest: NDArray[np.int64]
    nearest_weight: NDArray[np.float64]

    @property
    def values(self) -> NDArray[np.float64]:
        """LCoR, (m,): 1 where the query is near expert-like references alone, 0 near none."""
        return self.numerator / self.denominator

    @property
    def effective_sample_size(self) -> NDArray[np.float64]:
        """(Σ w)² / Σ w², (m,): how many references the answer rests on; larger is safer."""
        return self.denominator**2 / self.squares

    @classmethod
    def empty(cls, contributors: int) -> Sums:
        """Return the sums of no queries.

        Parameters
        ----------
        contributors
            Columns c of `nearest`.
        """
        nearest = np.empty((0, contributors))
        return cls(*np.empty((4, 0)), nearest=nearest.astype(np.int64), nearest_weight=nearest)

    @classmethod
    def join(cls, parts: Sequence[Sums]) -> Sums:
        """Return the sums of the queries of all parts, one part after the other.

        Parameters
        ----------
        parts
            Sums of different queries over the same references, at least one.
        """
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def take(self, rows: NDArray[np.int64]) -> Sums:
        """Return the sums of some of the queries.

        Parameters
        ----------
        rows
            Indices of queries, in the order wanted.
        """
        return Sums(*(getattr(self, field.name)[rows] for field in fields(self)))

    def __add__(self, other: Sums) -> Sums:
        """Add the sums of another shard, same queries; rows of `nearest` are numbered over both."""
        scale = np.maximum(self.log_scale, other.log_scale)
        ours = np.exp(self.log_scale - scale)
        theirs = np.exp(other.log_scale - scale)
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
