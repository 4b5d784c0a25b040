"""Rules that judge a claim by numbers of several seeds: reproduced, not reproduced, contradicted.

A direction has support if it holds in 95 % of bootstrap resamples of the seeds. It is reproduced
with support for it, contradicted with support for the opposite, and not reproduced otherwise.
Fewer than three seeds judge nothing. The bootstrap of few seeds is generous: of two methods that
are equally good, three seeds each lie apart in one case of ten.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ssil_data.quality import spearman
from ssil_trainers.experiments.statistics import deviation, support

SUPPORT = 0.95
FEWEST_SEEDS = 3


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

    Reproduced if the direction has support and the factor lies within or below the 95 % interval.
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
        higher = support(better, worse, lambda a, b: a.mean(1) - b.mean(1))
        as_much = support(better, worse, lambda a, b: a.mean(1) - self.factor * b.mean(1))
        by = f"{_spread(better)} against {_spread(worse)}; higher in {higher:.0%} of resamples"
        if higher < SUPPORT:
            return Judged(_opposed(higher), by)
        if as_much < (1 - SUPPORT) / 2:
            return Judged(Verdict.NOT_REPRODUCED, f"{by}, but by less than claimed")
        return Judged(Verdict.REPRODUCED, by)


@dataclass(frozen=True)
class Steadier:
    """The scores of `steadier` deviate less over seeds than those of `other`."""

    table: str
    labels: int | None
    steadier: str
    other: str

    def __call__(self, numbers: Numbers) -> Judged:
        """Compare the deviations."""
        both = _both(numbers, self.table, self.labels, self.steadier, self.other)
        if isinstance(both, Judged):
            return both
        steadier, other = both
        lower = support(steadier, other, lambda a, b: b.std(axis=1) - a.std(axis=1))
        by = (
            f"deviation {deviation(steadier):.3f} ({len(steadier)} seeds) against "
            f"{deviation(other):.3f} ({len(other)}); lower in {lower:.0%} of resamples"
        )
        return Judged(Verdict.REPRODUCED if lower >= SUPPORT else _opposed(lower), by)


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


def _both(
    numbers: Numbers, table: str, labels: int | None, *keys: str
) -> list[NDArray[np.float64]] | Judged:
    found = [numbers.scores.get((table, labels, key), np.empty(0)) for key in keys]
    fewest = min(len(scores) for scores in found)
    return found if fewest >= FEWEST_SEEDS else _too_few(fewest)


def _too_few(found: int) -> Judged:
    return Judged(Verdict.NOT_JUDGED, f"expected {FEWEST_SEEDS} seeds or more, found {found}")


def _opposed(share: float) -> Verdict:
    return Verdict.CONTRADICTED if share <= 1 - SUPPORT else Verdict.NOT_REPRODUCED


def _spread(scores: NDArray[np.float64]) -> str:
    return f"{scores.mean():.3f} ± {deviation(scores):.3f} ({len(scores)} seeds)"
