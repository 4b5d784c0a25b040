"""Statistics over several seeds: means, interquartile means, bootstrap intervals, curves.

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
"""Share of the resamples that an interval contains."""
TRIALS = 2_000
"""Pairs of equally good methods in the simulation of verdicts by chance."""

Excess = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
"""By how much resampled values (r, n, ...) exceed others (r, m, ...), as (r, ...)."""


@dataclass(frozen=True)
class Curve:
    """A learning curve.

    Parameters
    ----------
    steps:
        Environment steps, (m,), rising.
    scores:
        Score at each, (m,); 1 is as good as the expert.

    Examples
    --------
    >>> curve = Curve((0, 10, 20), (0.0, 0.5, 1.0))
    >>> curve.area, curve.steps_to(0.4), curve.steps_to(2.0)
    (0.5, 10, None)
    """

    steps: tuple[int, ...]
    scores: tuple[float, ...]

    def steps_to(self, score: float) -> int | None:
        """Return the steps after which a score was first reached; None if it never was.

        Parameters
        ----------
        score:
            The score to reach.
        """
        return next((s for s, at in zip(self.steps, self.scores, strict=True) if at >= score), None)

    @property
    def area(self) -> float:
        """Mean height of the curve, its points joined by straight lines; higher is better."""
        if len(self.steps) == 1:
            return self.scores[0]
        width = self.steps[-1] - self.steps[0]
        return float(np.trapezoid(self.scores, self.steps) / width)


@dataclass(frozen=True)
class Summary:
    """Summary of the final scores and learning curves of n seeds.

    Parameters
    ----------
    seeds:
        n.
    mean:
        Mean score; 1 is as good as the expert.
    deviation:
        Deviation of the sample (divided by n − 1); None for a single seed.
    interquartile_mean:
        Mean of the middle half.
    low:
        Lower end of its 95 % bootstrap interval.
    high:
        Upper end.
    reached:
        How many seeds reached 90 % of the expert.
    steps_to_90:
        Median over all seeds of the steps until then; None if half of them or more never did.
    area:
        Mean height of the learning curves.
    worst:
        The lowest score.
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
        """Summarize the scores and curves of n ≥ 1 seeds, given in the same order.

        Parameters
        ----------
        scores:
            Final scores, n of them.
        curves:
            Learning curves, in the same order.

        Examples
        --------
        >>> curve = Curve((0, 10), (0.0, 1.0))
        >>> summary = Summary.of([0.8, 1.0], [curve, curve])
        >>> summary.mean, summary.reached, summary.steps_to_90
        (0.9, 2, 10.0)
        """
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
    """Return the standard deviation of a sample (divided by n − 1).

    Parameters
    ----------
    values:
        The sample, (n,).

    Examples
    --------
    >>> deviation([1.0, 3.0]), deviation([1.0])
    (1.4142135623730951, None)
    """
    values = np.asarray(values, np.float64)
    return float(values.std(ddof=1)) if len(values) > 1 else None


def interquartile_mean(values: ArrayLike) -> float:
    """Return the mean of the middle half.

    A quarter of the values, rounded down, is left out at each end; three values or fewer are all
    kept.

    Parameters
    ----------
    values:
        The sample, (n,).

    Examples
    --------
    >>> interquartile_mean([-100, 1, 3, 1000])
    2.0
    """
    return float(_interquartile_means(np.asarray(values, np.float64)[None])[0])


def interval(strata: Sequence[ArrayLike]) -> tuple[float, float]:
    """Return the 95 % bootstrap interval of the interquartile mean of all values.

    Parameters
    ----------
    strata:
        Samples; each resample draws within each of them.

    Examples
    --------
    >>> interval([[0.0, 0.0], [1.0, 1.0]])
    (0.5, 0.5)
    """
    resamples = [resample(stratum, seed) for seed, stratum in enumerate(strata)]
    tail = (1 - INTERVAL) / 2
    means = _interquartile_means(np.concatenate(resamples, axis=1))
    low, high = np.quantile(means, [tail, 1 - tail])
    return float(low), float(high)


def support(first: ArrayLike, second: ArrayLike, excess: Excess) -> float:
    """Return the share of bootstrap resamples in which `excess` is above 0; ties count half.

    Parameters
    ----------
    first:
        Scores of one method, (n,).
    second:
        Scores of the other, (m,).
    excess:
        By how much the first exceeds the second.

    Returns
    -------
    :
        1 if the first exceeds the second in every resample, 0 if in none.

    Examples
    --------
    >>> support([1.0, 1.1], [0.0, 0.1], lambda a, b: a.mean(axis=1) - b.mean(axis=1))
    1.0
    """
    return float(_supports(resample(first, 0), resample(second, 1), excess))


def false_verdict_rate(excess: Excess, seeds: int, level: float) -> float:
    """Simulate how often one of two equally good methods gets support.

    Parameters
    ----------
    excess:
        By how much one method exceeds the other.
    seeds:
        Number of scores of each method, drawn from the same normal distribution.
    level:
        Support that makes a verdict, in either direction.

    Returns
    -------
    :
        The share of trials with a verdict; lower is better.
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
    """Draw bootstrap resamples.

    Parameters
    ----------
    values:
        The sample, (n, ...).
    seed:
        Seed of the draw.

    Returns
    -------
    :
        Resamples with replacement, (RESAMPLES, n, ...).
    """
    values = np.asarray(values, np.float64)
    rows = np.random.default_rng(seed).integers(len(values), size=(RESAMPLES, len(values)))
    return values[rows]


def _supports(
    first: NDArray[np.float64], second: NDArray[np.float64], excess: Excess
) -> NDArray[np.float64]:
    """Return the support of each of several pairs of methods at once."""
    found = excess(first, second)
    return (found > 0).mean(axis=0) + (found == 0).mean(axis=0) / 2


def _interquartile_means(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the interquartile mean (r,) of each row (r, n)."""
    cut = values.shape[1] // 4
    ordered = np.sort(values, axis=1)
    return ordered[:, cut : values.shape[1] - cut].mean(axis=1)
