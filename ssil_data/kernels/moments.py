"""What the regression estimate of LCoR knows: moments of the sample, and of all references."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class SampleMoments:
    """Sums over the n references of a sample, about m queries.

    With λ = l − mean(l), and for each query w the kernel relative to the one at the query's mean
    distance d₀ and u = (d − d₀) / (α + d₀):

    sample (3,) is Σ 1, Σ λ, Σ λ². products (15, m) is Σ of u, u², w, w u and w² in this order, each
    times 1, λ and λ².
    """

    sample: NDArray[np.float64]
    products: NDArray[np.float64]

    @classmethod
    def zero(cls, count: int) -> SampleMoments:
        """Return the moments of an empty sample.

        Parameters
        ----------
        count
            Number m of queries.
        """
        return cls(np.zeros(3), np.zeros((15, count)))

    def __add__(self, other: SampleMoments) -> SampleMoments:
        """Add the moments of another part of the sample, about the same queries."""
        return SampleMoments(self.sample + other.sample, self.products + other.products)

    def take(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> SampleMoments:
        """Return the moments about some of the queries.

        Parameters
        ----------
        rows
            Indices of queries, in the order wanted, or a mask (m,).
        """
        return SampleMoments(self.sample, self.products[:, rows])

    @classmethod
    def join(cls, parts: Sequence[SampleMoments]) -> SampleMoments:
        """Return the moments about the queries of all parts, one part after the other.

        Parameters
        ----------
        parts
            Moments of one and the same sample, at least one.
        """
        return cls(parts[0].sample, np.concatenate([part.products for part in parts], axis=1))


@dataclass(frozen=True)
class Population:
    """What is known of the leverages l of all N references, with λ = l − mean(l).

    count is N, mean the mean leverage, rest Σ λ (not 0 only because `mean` is rounded to float32),
    variance Σ λ² / N, and ends the least and the greatest leverage. typical is (Σ λ²)² / (N Σ λ⁴):
    about the share of the references that carry the variance.
    """

    count: int
    mean: float
    rest: float
    variance: float
    typical: float
    ends: tuple[float, float]

    @classmethod
    def of(cls, leverage: NDArray[np.float32]) -> Population:
        """Measure the leverages of all references.

        Parameters
        ----------
        leverage
            Leverages (N,), N ≥ 1.
        """
        mean = float(np.float32(leverage.mean(dtype=np.float64)))
        away = leverage - np.float32(mean)
        square = np.square(away)
        second = square.mean(dtype=np.float64)
        fourth = np.square(square).mean(dtype=np.float64)
        return cls(
            count=len(leverage),
            mean=mean,
            rest=float(away.sum(dtype=np.float64)),
            variance=float(second),
            typical=float(second**2 / fourth) if fourth > 0 else 1.0,
            ends=(float(leverage.min()), float(leverage.max())),
        )

    def farthest(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how wrong an LCoR can be at most: its distance to the farther end of leverage.

        Parameters
        ----------
        values
            LCoR (m,).
        """
        low, high = self.ends
        return np.maximum(values - low, high - values)
