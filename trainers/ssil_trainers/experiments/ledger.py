"""Rules that judge a claim by numbers of several seeds: reproduced, not reproduced, contradicted.

A direction has support if it holds in 95 % of bootstrap resamples of the seeds. It is reproduced
with support for it, contradicted with support for the opposite, and not reproduced otherwise. A
difference below .01 of the expert's score is a tie, whatever its support, and not reproduced. Fewer
than three seeds judge nothing. The bootstrap of few seeds is generous: `by_chance` is how often
methods that are equally good get a verdict all the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ssil_data.quality import spearman
from ssil_trainers.experiments.statistics import Excess, deviation, false_verdict_rate, support

SUPPORT = 0.95
FEWEST_SEEDS = 3
TIE = 0.01
"""Means, or deviations, that differ by less, in shares of the expert's score, are equal."""


class Verdict(StrEnum):
    """What became of a claim."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    CONTRADICTED = "contradicted"
    NOT_JUDGED = "not judged"


@dataclass(frozen=True)
class Numbers:
    """What was measured.

    scores: final scores (seeds,) by table, labels and row. tiers: mean leverage (seeds, tiers),
    worst tier first, of each estimator under the paper's scale.
    """

    scores: Mapping[tuple[str, int | None, str], NDArray[np.float64]] = field(default_factory=dict)
    tiers: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    def highest(self, table: str) -> float:
        """Return the highest score of any method of a table in any seed."""
        found = [scores for (name, *_), scores in self.scores.items() if name == table]
        return float(np.concatenate(found).max())


@dataclass(frozen=True)
class Judged:
    """A verdict, and the numbers it was judged by in words."""

    verdict: Verdict
    by: str


class Rule(Protocol):
    """Judges one claim."""

    def __call__(self, numbers: Numbers) -> Judged:
        """Return the verdict."""
        ...


@dataclass(frozen=True)
class Exceeds:
    """`better` has `factor` times the mean score of `worse`, or more.

    Reproduced if the direction has support, the means are no tie, and the factor lies within or
    below the 95 % interval. A factor that would take more than the highest score which any method
    of the table reached in any seed is beyond the ceiling; that is told, and changes no verdict.
    """

    table: str
    labels: int | None
    better: str
    worse: str
    factor: float = 1.0

    def __call__(self, numbers: Numbers) -> Judged:
        """Compare the means."""
        both = _both(numbers, self.table, self.labels, self.better, self.worse)
        if isinstance(both, Judged):
            return both
        better, worse = both
        higher = support(better, worse, _higher(1.0))
        as_much = support(better, worse, _higher(self.factor))
        by = f"{_score_range(better)} against {_score_range(worse)}; higher in {higher:.0%} of resamples"
        found = _verdict(float(better.mean() - worse.mean()), higher, as_much, by)
        needed, top = self.factor * float(worse.mean()), numbers.highest(self.table)
        if found.verdict is not Verdict.REPRODUCED and needed > top:
            ceiling = f"ceiling: as much would be {needed:.3f}, the highest score is {top:.3f}"
            return Judged(found.verdict, f"{found.by}; {ceiling}")
        return found


@dataclass(frozen=True)
class Steadier:
    """The scores of `steadier` deviate over seeds by `share` of what those of `other` do, or less.

    Judged as `Exceeds`, by resampled deviations. Three seeds cannot decide it: one resample in nine
    draws the same seed three times.
    """

    table: str
    labels: int | None
    steadier: str
    other: str
    share: float = 1.0

    def __call__(self, numbers: Numbers) -> Judged:
        """Compare the deviations."""
        both = _both(numbers, self.table, self.labels, self.steadier, self.other)
        if isinstance(both, Judged):
            return both
        steadier, other = both
        lower = support(steadier, other, _steadier(1.0))
        as_little = support(steadier, other, _steadier(self.share))
        less, more = (float(np.std(scores, ddof=1)) for scores in both)
        by = (
            f"deviation {less:.3f} ({len(steadier)} seeds) against "
            f"{more:.3f} ({len(other)}); lower in {lower:.0%} of resamples"
        )
        if min(len(steadier), len(other)) == FEWEST_SEEDS:
            by = f"{by}; three seeds cannot decide it"
        return _verdict(more - less, lower, as_little, by)


@dataclass(frozen=True)
class Rises:
    """Mean leverage rises from tier to tier with the quality of the demonstrations.

    Reproduced if it does in every seed; contradicted if, in the means over seeds, it falls or has
    no rank correlation with quality.
    """

    estimator: str

    def __call__(self, numbers: Numbers) -> Judged:
        """Look at the tiers seed by seed."""
        tiers = numbers.tiers.get(self.estimator)
        if tiers is None or len(tiers) < FEWEST_SEEDS:
            return _too_few(0 if tiers is None else len(tiers))
        rising = (np.diff(tiers, axis=1) > 0).all(axis=1)
        means = tiers.mean(axis=0)
        by = f"{' '.join(f'{mean:.3f}' for mean in means)}; rises in {rising.sum()} of {len(tiers)}"
        if rising.all():
            return Judged(Verdict.REPRODUCED, by)
        falls = (spearman(means, np.arange(len(means))) or 0.0) <= 0
        return Judged(Verdict.CONTRADICTED if falls else Verdict.NOT_REPRODUCED, by)


@dataclass(frozen=True)
class Claim:
    """One sentence, where it stands, the rule that judges it, and what else there is to know."""

    statement: str
    where: str
    rule: Rule
    note: str = ""


@dataclass(frozen=True)
class Chance:
    """How often equally good methods get a verdict about their means, or about their deviations."""

    means: float
    deviations: float


@cache
def by_chance(seeds: int) -> Chance | None:
    """Simulate verdicts about equal methods of normal scores; None where nothing is judged.

    As if they deviated by so much that ties were rare: ties make it less.
    """
    if seeds < FEWEST_SEEDS:
        return None
    return Chance(
        means=false_verdict_rate(_higher(1.0), seeds, SUPPORT),
        deviations=false_verdict_rate(_steadier(1.0), seeds, SUPPORT),
    )


def _both(
    numbers: Numbers, table: str, labels: int | None, *keys: str
) -> list[NDArray[np.float64]] | Judged:
    found = [numbers.scores.get((table, labels, key), np.empty(0)) for key in keys]
    fewest = min(len(scores) for scores in found)
    return found if fewest >= FEWEST_SEEDS else _too_few(fewest)


def _too_few(found: int) -> Judged:
    return Judged(Verdict.NOT_JUDGED, f"expected {FEWEST_SEEDS} seeds or more, found {found}")


def _verdict(excess: float, direction: float, size: float, by: str) -> Judged:
    """Judge by what was measured, its support, and the support of the size that was claimed."""
    if abs(excess) < TIE:
        return Judged(Verdict.NOT_REPRODUCED, f"{by}; tie")
    if direction <= 1 - SUPPORT:
        return Judged(Verdict.CONTRADICTED, by)
    if direction < SUPPORT:
        return Judged(Verdict.NOT_REPRODUCED, by)
    if size < (1 - SUPPORT) / 2:
        return Judged(Verdict.NOT_REPRODUCED, f"{by}, but by less than claimed")
    return Judged(Verdict.REPRODUCED, by)


def _higher(factor: float) -> Excess:
    return lambda first, second: first.mean(axis=1) - factor * second.mean(axis=1)


def _steadier(share: float) -> Excess:
    return lambda first, second: share * second.std(axis=1) - first.std(axis=1)


def _score_range(scores: NDArray[np.float64]) -> str:
    return f"{scores.mean():.3f} ± {deviation(scores):.3f} ({len(scores)} seeds)"
