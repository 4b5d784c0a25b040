"""Rules that judge a claim by several seeds: reproduced, not reproduced or contradicted.

A direction has support if it holds in 95 % of bootstrap resamples of the seeds. A claim is
reproduced if its direction has support, contradicted if the opposite direction has, and not
reproduced otherwise. A difference below .01 of the expert's score is a tie, whatever its support,
and counts as not reproduced. Fewer than three seeds are not judged. The bootstrap of few seeds is
generous: `verdicts_by_chance` simulates how often equally good methods get a verdict all the same.
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
    """The outcome of judging a claim."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    CONTRADICTED = "contradicted"
    NOT_JUDGED = "not judged"


@dataclass(frozen=True)
class Numbers:
    """What was measured.

    Parameters
    ----------
    scores:
        Final scores (seeds,) by table, number of labels and row; 1 is as good as the expert.
    tiers:
        Mean leverage (seeds, tiers), worst tier first, by estimator, with the paper's scale.
    """

    scores: Mapping[tuple[str, int | None, str], NDArray[np.float64]] = field(default_factory=dict)
    tiers: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    def highest(self, table: str) -> float:
        """Return the highest score of any method of a table in any seed.

        Parameters
        ----------
        table:
            Name of the table.
        """
        found = [scores for (name, *_), scores in self.scores.items() if name == table]
        return float(np.concatenate(found).max())


@dataclass(frozen=True)
class Judgment:
    """A verdict, and the numbers behind it.

    Parameters
    ----------
    verdict:
        The verdict.
    by:
        The numbers, in words.
    """

    verdict: Verdict
    by: str


class Rule(Protocol):
    """Judges a claim."""

    def __call__(self, numbers: Numbers) -> Judgment:
        """Return the verdict."""
        ...


@dataclass(frozen=True)
class Exceeds:
    """The claim that `better` has at least `factor` times the mean score of `worse`.

    It is reproduced if the direction has support, the means are not a tie, and the factor lies
    within or below its 95 % interval. A factor that would need more than the highest score of any
    method of the table in any seed is beyond the ceiling; the numbers say so, and the verdict does
    not change.

    Parameters
    ----------
    table:
        Name of the table.
    labels:
        Number of labels; None is all.
    better:
        Key of the row that is claimed to be better.
    worse:
        Key of the other row.
    factor:
        Claimed factor between the means.
    """

    table: str
    labels: int | None
    better: str
    worse: str
    factor: float = 1.0

    def __call__(self, numbers: Numbers) -> Judgment:
        """Compare the means."""
        both = _find_scores(numbers, self.table, self.labels, self.better, self.worse)
        if isinstance(both, Judgment):
            return both
        better, worse = both
        higher = support(better, worse, _higher(1.0))
        as_much = support(better, worse, _higher(self.factor))
        by = (
            f"{_score_range(better)} against {_score_range(worse)}; "
            f"higher in {higher:.0%} of resamples"
        )
        found = _judge(float(better.mean() - worse.mean()), higher, as_much, by)
        needed = self.factor * float(worse.mean())
        top = numbers.highest(self.table)
        if found.verdict is not Verdict.REPRODUCED and needed > top:
            ceiling = f"ceiling: as much would be {needed:.3f}, the highest score is {top:.3f}"
            return Judgment(found.verdict, f"{found.by}; {ceiling}")
        return found


@dataclass(frozen=True)
class Steadier:
    """The claim that the deviation over seeds of `steadier` is at most `share` of that of `other`.

    It is judged as `Exceeds` is, with deviations of the resamples. Three seeds cannot decide it:
    one resample in nine draws the same seed three times.

    Parameters
    ----------
    table:
        Name of the table.
    labels:
        Number of labels; None is all.
    steadier:
        Key of the row that is claimed to deviate less.
    other:
        Key of the other row.
    share:
        Claimed share of the deviation.
    """

    table: str
    labels: int | None
    steadier: str
    other: str
    share: float = 1.0

    def __call__(self, numbers: Numbers) -> Judgment:
        """Compare the deviations."""
        both = _find_scores(numbers, self.table, self.labels, self.steadier, self.other)
        if isinstance(both, Judgment):
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
        return _judge(more - less, lower, as_little, by)


@dataclass(frozen=True)
class Rises:
    """The claim that mean leverage rises from tier to tier with the demonstrations' quality.

    It is reproduced if leverage rises in every seed, and contradicted if its means over seeds have
    no rank correlation with quality, or a negative one.

    Parameters
    ----------
    estimator:
        Estimator of the leverage.
    """

    estimator: str

    def __call__(self, numbers: Numbers) -> Judgment:
        """Compare the tiers seed by seed."""
        tiers = numbers.tiers.get(self.estimator)
        if tiers is None or len(tiers) < FEWEST_SEEDS:
            return _too_few(0 if tiers is None else len(tiers))
        rising = (np.diff(tiers, axis=1) > 0).all(axis=1)
        means = tiers.mean(axis=0)
        by = f"{' '.join(f'{mean:.3f}' for mean in means)}; rises in {rising.sum()} of {len(tiers)}"
        if rising.all():
            return Judgment(Verdict.REPRODUCED, by)
        falls = (spearman(means, np.arange(len(means))) or 0.0) <= 0
        return Judgment(Verdict.CONTRADICTED if falls else Verdict.NOT_REPRODUCED, by)


@dataclass(frozen=True)
class Claim:
    """One sentence of the paper, and how it is judged.

    Parameters
    ----------
    statement:
        The sentence.
    where:
        Section of the paper.
    rule:
        Judges it.
    note:
        Anything else to know, such as that the paper's own table says otherwise.
    """

    statement: str
    where: str
    rule: Rule
    note: str = ""


@dataclass(frozen=True)
class Chance:
    """How often equally good methods get a verdict, as a share.

    Parameters
    ----------
    means:
        A verdict about their means.
    deviations:
        A verdict about their deviations.
    """

    means: float
    deviations: float


@cache
def verdicts_by_chance(seeds: int) -> Chance | None:
    """Simulate how often equally good methods with normal scores get a verdict.

    The simulated scores deviate so much that ties are rare; with ties there are fewer verdicts.

    Parameters
    ----------
    seeds:
        Number of seeds of each method.

    Returns
    -------
    :
        The shares; None for fewer seeds than are judged.
    """
    if seeds < FEWEST_SEEDS:
        return None
    return Chance(
        means=false_verdict_rate(_higher(1.0), seeds, SUPPORT),
        deviations=false_verdict_rate(_steadier(1.0), seeds, SUPPORT),
    )


def _find_scores(
    numbers: Numbers, table: str, labels: int | None, *keys: str
) -> list[NDArray[np.float64]] | Judgment:
    """Return the scores of rows; the judgment of too few seeds if one has not enough."""
    found = [numbers.scores.get((table, labels, key), np.empty(0)) for key in keys]
    fewest = min(len(scores) for scores in found)
    return found if fewest >= FEWEST_SEEDS else _too_few(fewest)


def _too_few(found: int) -> Judgment:
    """Judge nothing, and say why."""
    return Judgment(Verdict.NOT_JUDGED, f"expected {FEWEST_SEEDS} seeds or more, found {found}")


def _judge(excess: float, direction: float, size: float, by: str) -> Judgment:
    """Judge by a difference, the support of its direction, and that of the claimed size."""
    if abs(excess) < TIE:
        return Judgment(Verdict.NOT_REPRODUCED, f"{by}; tie")
    if direction <= 1 - SUPPORT:
        return Judgment(Verdict.CONTRADICTED, by)
    if direction < SUPPORT:
        return Judgment(Verdict.NOT_REPRODUCED, by)
    if size < (1 - SUPPORT) / 2:
        return Judgment(Verdict.NOT_REPRODUCED, f"{by}, but by less than claimed")
    return Judgment(Verdict.REPRODUCED, by)


def _higher(factor: float) -> Excess:
    """Return by how much one mean exceeds `factor` times another."""
    return lambda first, second: first.mean(axis=1) - factor * second.mean(axis=1)


def _steadier(share: float) -> Excess:
    """Return by how much a deviation stays below `share` of another."""
    return lambda first, second: share * second.std(axis=1) - first.std(axis=1)


def _score_range(scores: NDArray[np.float64]) -> str:
    """Write mean and deviation of scores."""
    return f"{scores.mean():.3f} ± {deviation(scores):.3f} ({len(scores)} seeds)"
