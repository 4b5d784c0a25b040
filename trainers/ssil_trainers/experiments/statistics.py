"""What several seeds say together: means, interquartile means, bootstrap intervals, curves.

Interquartile mean and stratified bootstrap are those of Agarwal et al. 2021, *Deep reinforcement
learning at the edge of the statistical precipice*: resamples draw seeds within each stratum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

RESAMPLES = 10_000
INTERVAL = 0.95
"""How much of the resamples an interval holds."""
TRIALS = 2_000
"""Pairs of equally good methods in a simulation of verdicts by chance."""

Excess = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
"""How much of something resampled values (r, n, ...) have beyond others (r, m, ...): (r, ...)."""


@dataclass(frozen=True)
class Curve:
    """Scores (m,) at numbers of environment steps (m,), which rise."""

    steps: tuple[int, ...]
    scores: tuple[float, ...]

    def steps_to(self, score: float) -> int | None:
        """Return the first number of steps at which a score was reached; None if it never was."""
        return next((s for s, at in zip(self.steps, self.scores, strict=True) if at >= score), None)

    @property
    def area(self) -> float:
        """The mean height of the curve, its points joined by straight lines."""
        if len(self.steps) == 1:
            return self.scores[0]
        width = self.steps[-1] - self.steps[0]
        return float(np.trapezoid(self.scores, self.steps) / width)


@dataclass(frozen=True)
class Summary:
    """Final scores and curves of n seeds.

    deviation: of a sample (n − 1), None of a single seed. low, high: 95 % bootstrap interval of the
    interquartile mean. reached: how many seeds came to 90 % of the expert, and steps_to_90 the
    median of when, over all seeds: None if half of them or more never did. area: mean height of the
    curves. worst: the least score.
    """

    seeds: int
    mean: float
    deviation: float | None
    interquartile_mean: float
    low: float
    high: float
    reached: int
    steps_to_90: float | None
    area: float
    worst: float

    @classmethod
    def of(cls, scores: Sequence[float], curves: Sequence[Curve]) -> Summary:
        """Summarise the scores and curves of n ≥ 1 seeds."""
        values = np.asarray(scores, np.float64)
        low, high = interval([values])
        reached = [curve.steps_to(0.9) for curve in curves]
        median = float(np.median([np.inf if steps is None else steps for steps in reached]))
        return cls(
            seeds=len(values),
            mean=float(values.mean()),
            deviation=deviation(values),
            interquartile_mean=interquartile_mean(values),
            low=low,
            high=high,
            reached=sum(steps is not None for steps in reached),
            steps_to_90=median if np.isfinite(median) else None,
            area=float(np.mean([curve.area for curve in curves])),
            worst=float(values.min()),
        )


def deviation(values: ArrayLike) -> float | None:
    """Return the deviation of a sample; None of fewer than two values."""
    values = np.asarray(values, np.float64)
    return float(values.std(ddof=1)) if len(values) > 1 else None


def interquartile_mean(values: ArrayLike) -> float:
    """Return the mean of the middle half: a quarter, rounded down, is left out at either end.

    Of three values or fewer that is their mean.
    """
    return float(_interquartile_means(np.asarray(values, np.float64)[None])[0])


def interval(strata: Sequence[ArrayLike]) -> tuple[float, float]:
    """Return the bootstrap interval of the interquartile mean of all values of all strata."""
    drawn = np.concatenate([resample(stratum, seed) for seed, stratum in enumerate(strata)], 1)
    tail = (1 - INTERVAL) / 2
    low, high = np.quantile(_interquartile_means(drawn), [tail, 1 - tail])
    return float(low), float(high)


def support(first: ArrayLike, second: ArrayLike, excess: Excess) -> float:
    """Return the share of resamples in which `excess` is above 0, ties half."""
    return float(_supports(resample(first, 0), resample(second, 1), excess))


def false_verdict_rate(excess: Excess, seeds: int, level: float) -> float:
    """Return how often equally good methods get support of `level`, one way or the other.

    Simulated: both have so many normal scores of the same mean and deviation.
    """
    rng = np.random.default_rng(0)
    few = 50  # resamples of many trials at once would fill the memory
    found = [
        _supports(
            resample(rng.normal(size=(seeds, few)), 0),
            resample(rng.normal(size=(seeds, few)), 1),
            excess,
        )
        for _ in range(TRIALS // few)
    ]
    shares = np.concatenate(found)
    return float(((shares >= level) | (shares <= 1 - level)).mean())


def resample(values: ArrayLike, seed: int) -> NDArray[np.float64]:
    """Draw resamples (RESAMPLES, n, ...) of n values (n, ...) with replacement."""
    values = np.asarray(values, np.float64)
    rows = np.random.default_rng(seed).integers(len(values), size=(RESAMPLES, len(values)))
    return values[rows]


def _supports(
    first: NDArray[np.float64], second: NDArray[np.float64], excess: Excess
) -> NDArray[np.float64]:
    found = excess(first, second)
    return (found > 0).mean(axis=0) + (found == 0).mean(axis=0) / 2


def _interquartile_means(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the interquartile mean (r,) of each row (r, n)."""
    cut = values.shape[1] // 4
    ordered = np.sort(values, axis=1)
    return ordered[:, cut : values.shape[1] - cut].mean(axis=1)
