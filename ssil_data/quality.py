"""How well leverage ranks true quality, where it is known: by tier, AUROC, rank correlation.

Only unlabeled episodes are judged: the labeled ones taught the estimator. True score and tier are
read here and in reports alone, never by an estimator or a trainer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from ssil_data.store.dataset import Dataset

EXPERT = "expert"
"""The tier of expert demonstrations; every other tier is negative."""


@dataclass(frozen=True)
class Quality:
    """What is known of a run's leverage; None where the dataset lacks tiers or scores.

    mean_leverage_by_tier: mean over the unlabeled pairs of each tier, worst tier first.
    auroc: chance that an expert pair has more leverage than a negative one, ties half.
    auroc_length_matched: the same with each negative episode against the beginning of an expert
    episode of its length, so that short episodes are not told by being early in a drive.
    spearman: rank correlation of an episode's mean leverage with its true score.
    spearman_given_length: the same with the rank of the episode's length held constant (partial).
    """

    mean_leverage_by_tier: dict[str, float]
    auroc: float | None
    auroc_length_matched: float | None
    spearman: float | None
    spearman_given_length: float | None


def quality(dataset: Dataset, leverage: NDArray[np.float32]) -> Quality:
    """Judge the leverage (n,) that a run gave to the pairs of a dataset."""
    drives = _Drives(dataset.episodes, leverage)
    expert, negative = drives.of_tier(EXPERT), drives.negative
    both = bool(len(expert) and len(negative))
    scored = drives.scored
    means, scores = drives.mean[scored], drives.score[scored]
    lengths = drives.length[scored]
    return Quality(
        mean_leverage_by_tier={tier: drives.tier_mean(tier) for tier in drives.tiers},
        auroc=auroc(drives.pairs(expert), drives.pairs(negative)) if both else None,
        auroc_length_matched=drives.length_matched_auroc(expert, negative) if both else None,
        spearman=spearman(means, scores),
        spearman_given_length=partial_spearman(means, scores, lengths),
    )


def auroc(high: ArrayLike, low: ArrayLike) -> float:
    """Return the chance that a value of `high` exceeds one of `low`, ties half (Mann–Whitney)."""
    high, low = np.asarray(high), np.asarray(low)
    ranks = _ranks(np.concatenate([high, low]))
    excess = ranks[: len(high)].sum() - len(high) * (len(high) + 1) / 2
    return float(excess / (len(high) * len(low)))


def spearman(values: ArrayLike, others: ArrayLike) -> float | None:
    """Return Spearman's rank correlation; None if either is constant or there are under three."""
    return _pearson(_ranks(values), _ranks(others))


def partial_spearman(values: ArrayLike, others: ArrayLike, given: ArrayLike) -> float | None:
    """Return Spearman's rank correlation with the rank of a third quantity held constant."""
    between = spearman(values, others)
    if between is None:
        return None
    to_values, to_others = spearman(values, given), spearman(others, given)
    if to_values is None or to_others is None:
        return between
    spread = np.sqrt((1 - to_values**2) * (1 - to_others**2))
    return float((between - to_values * to_others) / spread) if spread > 1e-12 else None


class _Drives:
    """The unlabeled episodes: their rows, lengths, tiers, true scores and mean leverage."""

    def __init__(self, episodes: pa.Table, leverage: NDArray[np.float32]) -> None:
        stops = np.cumsum(episodes["length"].to_numpy())
        unlabeled = ~episodes["labeled"].to_numpy()
        self.leverage = leverage
        self.length = episodes["length"].to_numpy()[unlabeled]
        self.first = stops[unlabeled] - self.length
        self.tier = np.array(episodes["tier"].to_pylist(), dtype=object)[unlabeled]
        self.score = episodes["score"].fill_null(np.nan).to_numpy()[unlabeled]
        self.scored = np.isfinite(self.score)
        sums = np.concatenate([[0.0], np.cumsum(leverage, dtype=np.float64)])
        self.mean = (sums[self.first + self.length] - sums[self.first]) / self.length

    @property
    def tiers(self) -> list[str]:
        """The tiers, worst first: by the number they begin with, the expert's last."""
        known = {tier for tier in self.tier if tier is not None}

        def place(tier: str) -> tuple[bool, float, str]:
            number = tier.split("-")[0]
            numbered = number.isascii() and number.isdecimal()
            return tier == EXPERT, float(number) if numbered else np.inf, tier

        return sorted(known, key=place)

    @property
    def negative(self) -> NDArray[np.int64]:
        return np.flatnonzero([tier not in (None, EXPERT) for tier in self.tier])

    def of_tier(self, tier: str) -> NDArray[np.int64]:
        return np.flatnonzero(self.tier == tier)

    def pairs(self, chosen: NDArray[np.int64]) -> NDArray[np.float32]:
        rows = [slice(self.first[i], self.first[i] + self.length[i]) for i in chosen]
        return np.concatenate([self.leverage[part] for part in rows])

    def tier_mean(self, tier: str) -> float:
        return float(self.pairs(self.of_tier(tier)).mean(dtype=np.float64))

    def length_matched_auroc(self, expert: NDArray[np.int64], negative: NDArray[np.int64]) -> float:
        """Pit the first L steps of each negative episode against those of an expert episode.

        Expert episodes of at least that length take turns; where none is, both are cut to the
        longest.
        """
        high, low = [], []
        longest = self.length[expert].max()
        for turn, index in enumerate(negative):
            steps = min(self.length[index], longest)
            able = expert[self.length[expert] >= steps]
            other = able[turn % len(able)]
            high.append(self.leverage[self.first[other] : self.first[other] + steps])
            low.append(self.leverage[self.first[index] : self.first[index] + steps])
        return auroc(np.concatenate(high), np.concatenate(low))


def _ranks(values: ArrayLike) -> NDArray[np.float64]:
    """Rank from 1, ties at their mean."""
    _, place, counts = np.unique(np.asarray(values), return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - (counts - 1) / 2)[place]


def _pearson(values: NDArray[np.float64], others: NDArray[np.float64]) -> float | None:
    if len(values) < 3 or not np.ptp(values) or not np.ptp(others):
        return None
    return float(np.corrcoef(values, others)[0, 1])
