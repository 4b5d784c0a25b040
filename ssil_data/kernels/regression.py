r"""LCoR from a random part of the references, by regression on what is known of all of them.

With λ_j = l_j − mean(l), the kernel k_j and λ_j k_j are regressed on φ_j = (1, λ_j, d_j, λ_j d_j),
whose totals over all N references are known; only what the regression leaves over is estimated from
the n in the sample (Cochran, Sampling Techniques, chapter 7):

    Ŝ_y = β_y · Σ_all φ,   LCoR = mean(l) + R,   R = Ŝ_λk / Ŝ_k
    Var R ≈ N² (1 − n/N) s² / (n Ŝ_k²),   s² the variance of the residual of λ k − R k

The half-width is the normal quantile of 99.9 % times the root of that, plus a floor that no larger
sample lowers: what the error bounds of the totals can move R, and what a single state can that lies
where the query is and was not drawn. The latter is what sampling misses where the kernel is sharp.
It is as good as the normal approximation, not a certificate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.estimates import Estimate
from ssil_data.kernels.formulas import log_kernel
from ssil_data.kernels.totals import DistanceSums

_ROUNDING_SHARE = 1e-6
"""Share of a sum of squares that float32 products and subtractions may invent."""
_RIDGE = 1e-12
_MIN_SPREAD = 0.5
"""Share of the leverages' variance that a sample must have for λ to explain anything."""


@dataclass(frozen=True, eq=False)
class SampleMoments:
    """Σ (1, λ, λ²) of a sample, and of m queries Σ (u, u², w, w u, w²) × (1, λ, λ²), (15, m).

    w is the kernel relative to that at the query's mean distance d₀, u = (d − d₀) / (α + d₀).
    """

    sample: NDArray[np.float64]
    products: NDArray[np.float64]

    @classmethod
    def zero(cls, count: int) -> SampleMoments:
        """Return the moments of an empty sample about `count` queries."""
        return cls(np.zeros(3), np.zeros((15, count)))

    def __add__(self, other: SampleMoments) -> SampleMoments:
        """Join two parts of a sample."""
        return SampleMoments(self.sample + other.sample, self.products + other.products)

    def take(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> SampleMoments:
        """Return the moments of the queries `rows`, in their order."""
        return SampleMoments(self.sample, self.products[:, rows])

    @classmethod
    def join(cls, parts: Sequence[SampleMoments]) -> SampleMoments:
        """Return the moments of the queries of some parts over one sample."""
        return cls(parts[0].sample, np.concatenate([part.products for part in parts], axis=1))


@dataclass(frozen=True)
class Population:
    """Of all references: how many, about the mean of their leverage, Σ λ, Σ λ² / N, the ends.

    `typical` is (Σ λ²)² / (N Σ λ⁴): about the share of references that carry their variance.
    """

    count: int
    mean: float
    rest: float
    variance: float
    typical: float
    ends: tuple[float, float]

    @classmethod
    def of(cls, leverage: NDArray[np.float32]) -> Population:
        """Measure leverage (n,); `mean` is a float32, so that λ can be one."""
        mean = float(np.float32(leverage.mean(dtype=np.float64)))
        away = leverage - np.float32(mean)
        square = np.square(away)
        second, fourth = square.mean(dtype=np.float64), np.square(square).mean(dtype=np.float64)
        return cls(
            count=len(leverage),
            mean=mean,
            rest=float(away.sum(dtype=np.float64)),
            variance=float(second),
            typical=float(second**2 / fourth) if fourth > 0 else 1.0,
            ends=(float(leverage.min()), float(leverage.max())),
        )

    def farthest(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far values are from the farther end of leverage."""
        low, high = self.ends
        return np.maximum(values - low, high - values)


def estimate(
    moments: SampleMoments, totals: DistanceSums, population: Population, alpha: float
) -> Estimate:
    """Return the regression estimate of LCoR; `totals` are those of the same queries."""
    count = moments.sample[0]
    # weights beyond float32 are no weights, so that the answer is not trusted
    finite = np.isfinite(moments.products).all(axis=0)
    (u, uu, w, wu, ww) = np.where(finite, moments.products, 0).reshape(5, 3, -1)
    ones = np.ones(u.shape[1])
    one, lam, square = (ones * value for value in moments.sample)
    gram = np.stack(
        [
            np.stack([one, lam, u[0], u[1]]),
            np.stack([lam, square, u[1], u[2]]),
            np.stack([u[0], u[1], uu[0], uu[1]]),
            np.stack([u[1], u[2], uu[1], uu[2]]),
        ]
    ).transpose(2, 0, 1)
    of_kernel = np.stack([w[0], w[1], wu[0], wu[1]], axis=1)
    of_both = np.stack([w[1], w[2], wu[1], wu[2]], axis=1)
    # where the sample lacks the leverages that differ, λ would be told apart from 1 by rounding
    balanced = moments.sample[2] >= _MIN_SPREAD * population.variance * count > 0
    used = np.arange(4) if balanced else np.array([0, 2])
    beta = np.zeros((len(ones), 4, 2))
    beta[:, used] = _solve(
        gram[:, used[:, None], used], np.stack([of_kernel, of_both], axis=2)[:, used]
    )
    # u is measured from the mean distance: its total over all references is 0
    reach = alpha + totals.plain / population.count
    lam_d = totals.weighted - population.mean * totals.plain
    lam_u = (lam_d - population.rest * totals.plain / population.count) / reach
    known = np.stack([population.count * ones, population.rest * ones, 0 * ones, lam_u], axis=1)
    sum_kernel, sum_both = np.einsum("mf,mfy->ym", known, beta)
    # no estimate of a positive sum may be far from the sample's own
    mean_kernel = np.maximum(w[0] / count, np.finfo(float).tiny)
    sum_kernel = np.clip(sum_kernel / (population.count * mean_kernel), 0.5, 2)
    sum_kernel *= population.count * mean_kernel
    ratio = sum_both / sum_kernel
    squares = ww[2] - 2 * ratio * ww[1] + ratio**2 * ww[0]
    slopes = beta[:, :, 1] - ratio[:, None] * beta[:, :, 0]
    explained = np.einsum("mf,mf->m", slopes, of_both - ratio[:, None] * of_kernel)
    squares = np.maximum(squares, 0)
    residual = np.maximum(squares - explained, _ROUNDING_SHARE * squares) / (count - 4)
    unseen = 1 - count / population.count
    deviation = population.count * np.sqrt(unseen * residual / count) / sum_kernel
    shift = np.abs(slopes[:, 2] - population.mean * slopes[:, 3]) * totals.plain_error
    shift += np.abs(slopes[:, 3]) * totals.weighted_error
    seen, squared = count / population.count, np.maximum(ww[0], np.finfo(float).tiny)
    values = np.clip(population.mean + ratio, *population.ends)
    with np.errstate(over="ignore"):
        here = np.exp(-log_kernel(reach - alpha, alpha))
    influence = 1 / (1 + sum_kernel / here)
    return Estimate(
        values=values,
        deviation=deviation,
        floor=shift / (reach * sum_kernel) + influence * population.farthest(values),
        effective_sample_size=np.clip(sum_kernel**2 * seen / squared, 1, population.count),
        support=np.minimum(w[0] ** 2 / squared, count * population.typical),
        influence=influence,
    )


def _solve(gram: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve (m, f, f) x = (m, f, 2), scaled to a unit diagonal; dependent features share."""
    scale = np.sqrt(np.maximum(np.einsum("mff->mf", gram), np.finfo(float).tiny))
    unit = gram / (scale[:, :, None] * scale[:, None, :]) + _RIDGE * np.eye(gram.shape[1])
    return np.linalg.solve(unit, right / scale[:, :, None]) / scale[:, :, None]
