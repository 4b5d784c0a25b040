r"""LCoR from a random sample of the references, by regression on what is known of all of them.

With λ_j = l_j − mean(l), both the kernel k_j and λ_j k_j are regressed on φ_j = (1, λ_j, d_j,
λ_j d_j). The totals of φ over all N references are known, so only what the regression leaves over
has to be estimated from the n references of the sample:

    Ŝ_y = β_y · Σ_all φ,   LCoR = mean(l) + R,   R = Ŝ_λk / Ŝ_k
    Var R ≈ N² (1 − n/N) s² / (n Ŝ_k²),   s² the variance of the residual of λ k − R k

The half-width is the normal quantile of 99.9 % times the root of that, plus a floor that no larger
sample lowers (see `_bounds`). It is as good as the normal approximation, not a certificate.

In place of k and d, the code has w = k(d) / k(d₀) and u = (d − d₀) / (α + d₀), with d₀ the query's
mean distance to all references. Both are linear in the former, so R is the same; Σ_all u is 0.

Source: Cochran, Sampling Techniques, chapter 7 (regression estimates).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.estimates import Estimate
from ssil_data.kernels.formulas import log_kernel
from ssil_data.kernels.moments import Population, SampleMoments
from ssil_data.kernels.totals import DistanceSums

_FEATURES = 4
_ROUNDING_SHARE = 1e-6
"""Share of a sum of squares that float32 products and subtractions may invent."""
_RIDGE = 1e-12
_MIN_SPREAD = 0.5
"""Share of the leverages' variance that a sample must have for λ to explain anything."""


def estimate(
    moments: SampleMoments, totals: DistanceSums, population: Population, alpha: float
) -> Estimate:
    """Estimate LCoR of m queries, with how far it may be off.

    Parameters
    ----------
    moments
        Of the sample about the queries.
    totals
        Sums of distances from the same queries to all references.
    population
        Of the leverages of all references.
    alpha
        Sharpness of the kernel, > 0.

    Returns
    -------
    Estimate
        Values within the range of the leverages. A query whose weights float32 could not hold gets
        a `support` of 0, so that it is not trusted.
    """
    design = _design(moments, totals, population, alpha)
    beta = _coefficients(design)
    sum_kernel, sum_product = _totals_by_regression(design, beta)
    ratio = sum_product / sum_kernel
    values = np.clip(population.mean + ratio, *population.ends)
    # coefficients of the residual's regression, of λ k − R k
    slopes = beta[:, :, 1] - ratio[:, None] * beta[:, :, 0]
    residual = _residual_variance(design, ratio, slopes)
    size = design.size
    unseen = 1 - size / population.count
    influence, floor = _bounds(design, totals, slopes, sum_kernel, values)
    squares = np.maximum(design.ww[0], np.finfo(float).tiny)
    seen = size / population.count
    return Estimate(
        values=values,
        deviation=population.count * np.sqrt(unseen * residual / size) / sum_kernel,
        floor=floor,
        effective_sample_size=np.clip(sum_kernel**2 * seen / squares, 1, population.count),
        support=np.minimum(design.w[0] ** 2 / squares, size * population.typical),
        influence=influence,
    )


@dataclass(frozen=True, eq=False)
class _Design:
    """The regression of m queries: features φ = (1, λ, u, λ u), targets w and λ w.

    size is n. gram (m, 4, 4) is Σ φ φᵀ, of_kernel (m, 4) Σ φ w and of_product (m, 4) Σ φ λ w, all
    over the sample; totals (m, 4) is Σ φ over all references. used are the columns of φ that the
    sample can tell apart. w (3, m) and ww (3, m) are Σ w and Σ w² times 1, λ, λ². scale (m,) is
    α + d₀, the unit of u.
    """

    population: Population
    alpha: float
    size: float
    gram: NDArray[np.float64]
    of_kernel: NDArray[np.float64]
    of_product: NDArray[np.float64]
    totals: NDArray[np.float64]
    used: NDArray[np.int64]
    w: NDArray[np.float64]
    ww: NDArray[np.float64]
    scale: NDArray[np.float64]


def _design(
    moments: SampleMoments, totals: DistanceSums, population: Population, alpha: float
) -> _Design:
    r"""Build the regression's sums from moments and totals.

    Σ_all φ = (N, Σ λ, Σ u, Σ λ u),   Σ_all u = 0,
    Σ_all λ u = (Σ λ d − d₀ Σ λ) / (α + d₀),   Σ λ d = Σ l d − mean(l) Σ d
    """
    # weights beyond float32 count as no weights, so that the answer is not trusted
    finite = np.isfinite(moments.products).all(axis=0)
    u, uu, w, wu, ww = np.where(finite, moments.products, 0).reshape(5, 3, -1)
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
    size = moments.sample[0]
    # where the sample lacks the leverages that differ, only rounding tells λ from a constant
    balanced = moments.sample[2] >= _MIN_SPREAD * population.variance * size > 0
    scale = alpha + totals.plain / population.count
    lam_d = totals.weighted - population.mean * totals.plain
    lam_u = (lam_d - population.rest * totals.plain / population.count) / scale
    return _Design(
        population=population,
        alpha=alpha,
        size=size,
        gram=gram,
        of_kernel=np.stack([w[0], w[1], wu[0], wu[1]], axis=1),
        of_product=np.stack([w[1], w[2], wu[1], wu[2]], axis=1),
        totals=np.stack([population.count * ones, population.rest * ones, 0 * ones, lam_u], axis=1),
        used=np.arange(_FEATURES) if balanced else np.array([0, 2]),
        w=w,
        ww=ww,
        scale=scale,
    )


def _coefficients(design: _Design) -> NDArray[np.float64]:
    r"""Return β (m, 4, 2) of w and λ w, 0 for features that are not used.

    (Σ φ φᵀ) β = Σ φ (w, λ w), scaled to a unit diagonal, with a ridge of 1e-12 so that features
    that depend on each other share a coefficient.
    """
    used = design.used
    gram = design.gram[:, used[:, None], used]
    right = np.stack([design.of_kernel, design.of_product], axis=2)[:, used]
    scale = np.sqrt(np.maximum(np.einsum("mff->mf", gram), np.finfo(float).tiny))
    unit = gram / (scale[:, :, None] * scale[:, None, :]) + _RIDGE * np.eye(gram.shape[1])
    beta = np.zeros((len(gram), _FEATURES, 2))
    beta[:, used] = np.linalg.solve(unit, right / scale[:, :, None]) / scale[:, :, None]
    return beta


def _totals_by_regression(
    design: _Design, beta: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Ŝ_w and Ŝ_λw, each (m,): Ŝ_y = β_y · Σ_all φ.

    Ŝ_w is positive, and kept within half and twice what the sample alone would say.
    """
    sum_kernel, sum_product = np.einsum("mf,mfy->ym", design.totals, beta)
    mean_kernel = np.maximum(design.w[0] / design.size, np.finfo(float).tiny)
    plain = design.population.count * mean_kernel
    return np.clip(sum_kernel / plain, 0.5, 2) * plain, sum_product


def _residual_variance(
    design: _Design, ratio: NDArray[np.float64], slopes: NDArray[np.float64]
) -> NDArray[np.float64]:
    r"""Return s² (m,), the variance of what the regression leaves over of e = λ w − R w.

        s² = (Σ e² − γ · Σ φ e) / (n − 4),   γ = β_λw − R β_w (`slopes`, (m, 4))
        Σ e² = Σ λ² w² − 2 R Σ λ w² + R² Σ w²

    The difference is no smaller than float32 can tell from Σ e².
    """
    ww = design.ww
    squares = np.maximum(ww[2] - 2 * ratio * ww[1] + ratio**2 * ww[0], 0)
    of_error = design.of_product - ratio[:, None] * design.of_kernel
    explained = np.einsum("mf,mf->m", slopes, of_error)
    left_over = np.maximum(squares - explained, _ROUNDING_SHARE * squares)
    return left_over / (design.size - _FEATURES)


def _bounds(
    design: _Design,
    totals: DistanceSums,
    slopes: NDArray[np.float64],
    sum_kernel: NDArray[np.float64],
    values: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    r"""Return influence and floor, each (m,): what no larger sample lowers.

        influence = 1 / (1 + Ŝ_w k(d₀)),   floor = shift / ((α + d₀) Ŝ_w) + influence · farthest
        shift = |γ_u − mean(l) γ_λu| · error(Σ d) + |γ_λu| · error(Σ l d)

    The first part of the floor is how far the error bounds of the totals can move R. The second is
    what one reference can do that lies where the query is and was not drawn: it is what sampling
    misses where the kernel is sharp.
    """
    population = design.population
    shift = np.abs(slopes[:, 2] - population.mean * slopes[:, 3]) * totals.plain_error
    shift += np.abs(slopes[:, 3]) * totals.weighted_error
    with np.errstate(over="ignore"):
        # w at distance 0, which is 1 / k(d₀)
        here = np.exp(-log_kernel(design.scale - design.alpha, design.alpha))
    influence = 1 / (1 + sum_kernel / here)
    floor = shift / (design.scale * sum_kernel) + influence * population.farthest(values)
    return influence, floor
