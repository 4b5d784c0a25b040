"""How well leverage ranks true quality, where it is known, and whether it is a chance.

By tier, AUROC, rank correlation; calibration and the share of the weight that experts get.

Only unlabeled episodes are judged: the estimator was fitted on the labeled ones. True score and
tier are read here and in reports alone, never by an estimator or a trainer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike, NDArray

from ssil_data.calibration import Calibration, find_calibration, refuse_nan
from ssil_data.errors import InvalidInputError
from ssil_data.store.dataset import Dataset

EXPERT = "expert"
"""The tier of expert demonstrations; every other tier is negative."""


@dataclass(frozen=True)
class Quality:
    """How well a run's leverage ranks true quality; None where the dataset lacks tiers or scores.

    Parameters
    ----------
    mean_leverage_by_tier
        Mean over the unlabeled pairs of each tier, worst tier first; it should rise.
    auroc
        Chance that an expert pair has more leverage than a negative one, ties half; 1 is best, 0.5
        is chance.
    auroc_length_matched
        The same with each negative episode against the beginning of an expert episode of its
        length, so that short episodes do not stand out by being early in a drive.
    spearman
        Rank correlation of an episode's mean leverage with its true score; 1 is best.
    spearman_given_length
        The same with the rank of the episode's length held constant (partial correlation).
    true_expert_share
        Share of expert pairs among the unlabeled ones of a tier; what a run estimates as its
        `expert_share`.
    true_weight_on_experts
        Share of the leverage that is on expert pairs: what they weigh in training that weights by
        leverage. 1 is best, `true_expert_share` is what all alike would give.
    true_calibration_error
        Mean absolute difference between leverage and the share of expert pairs, over ten bins of
        about equal numbers of pairs; 0 is best: of pairs with leverage .8, four in five are the
        expert's.

    Examples
    --------
    >>> judged = sd.measure_quality(dataset, dataset.leverage("vae"))
    >>> list(judged.mean_leverage_by_tier)
    ['0-25', '50-75', 'expert']
    """

    mean_leverage_by_tier: dict[str, float]
    auroc: float | None
    auroc_length_matched: float | None
    spearman: float | None
    spearman_given_length: float | None
    true_expert_share: float | None
    true_weight_on_experts: float | None
    true_calibration_error: float | None


def measure_quality(dataset: Dataset, leverage: NDArray[np.float32]) -> Quality:
    """Measure how well leverage ranks the true quality of a dataset's unlabeled episodes.

    Parameters
    ----------
    dataset
        Its episodes should have tiers or scores.
    leverage
        Of every pair, (n,).

    Returns
    -------
    Quality
        The measures; None where the dataset lacks what they need.

    Raises
    ------
    InvalidInputError
        Unless there is one number per pair.

    Examples
    --------
    >>> judged = sd.measure_quality(dataset, dataset.leverage("vae"))
    >>> judged.auroc > 0.5
    True
    """
    episodes = _UnlabeledEpisodes(dataset.episodes, leverage)
    expert = episodes.of_tier(EXPERT)
    negative = episodes.negative
    both = bool(len(expert) and len(negative))
    high = episodes.pairs(expert)
    low = episodes.pairs(negative)
    weight = float(high.sum(dtype=np.float64))
    total = weight + float(low.sum(dtype=np.float64))
    scored = episodes.scored
    means = episodes.mean[scored]
    scores = episodes.score[scored]
    return Quality(
        mean_leverage_by_tier={tier: episodes.tier_mean(tier) for tier in episodes.tiers},
        auroc=auroc(high, low) if both else None,
        auroc_length_matched=episodes.length_matched_auroc(expert, negative) if both else None,
        spearman=spearman(means, scores),
        spearman_given_length=partial_spearman(means, scores, episodes.length[scored]),
        true_expert_share=len(high) / (len(high) + len(low)) if both else None,
        true_weight_on_experts=weight / total if both and total else None,
        true_calibration_error=find_calibration(high, low).error if both else None,
    )


def compare_with_tiers(dataset: Dataset, leverage: NDArray[np.float32]) -> Calibration | None:
    """Compare leverage with the tiers of a dataset's unlabeled episodes: a calibration curve.

    Parameters
    ----------
    dataset
        Its episodes should have tiers.
    leverage
        Of every pair, (n,).

    Returns
    -------
    Calibration or None
        None unless there are expert pairs and others.

    Raises
    ------
    InvalidInputError
        Unless there is one number per pair.
    """
    episodes = _UnlabeledEpisodes(dataset.episodes, leverage)
    expert = episodes.pairs(episodes.of_tier(EXPERT))
    negative = episodes.pairs(episodes.negative)
    return find_calibration(expert, negative) if len(expert) and len(negative) else None


def auroc(high: ArrayLike, low: ArrayLike) -> float:
    """Return the area under the ROC curve: the chance that a value of `high` exceeds one of `low`.

    Ties count half. 1: every value of `high` is larger; 0.5: chance.

    Parameters
    ----------
    high, low
        At least one value each, (n,) and (m,), none of them NaN.

    Raises
    ------
    InvalidInputError
        For NaN, which has no rank, and for no value.

    Source
    ------
    Mann and Whitney, 1947: U / (n m).

    Examples
    --------
    >>> from ssil_data.quality import auroc
    >>> auroc([0.5, 0.9], [0.1, 0.5])
    0.875
    """
    one = refuse_nan("high", high)
    other = np.sort(refuse_nan("low", low))
    if not (one.size and other.size):
        raise InvalidInputError(
            f"auroc: needs values of both kinds, found {one.size} high and {other.size} low ones"
        )
    below = np.searchsorted(other, one, side="left").sum()
    up_to = np.searchsorted(other, one, side="right").sum()
    return float((below + up_to) / 2 / (len(one) * len(other)))


def spearman(values: ArrayLike, others: ArrayLike) -> float | None:
    """Return Spearman's rank correlation, from −1 (opposite orders) to 1 (the same order).

    Parameters
    ----------
    values, others
        (n,) each, without NaN.

    Returns
    -------
    float or None
        None if either is constant or there are under three.

    Raises
    ------
    InvalidInputError
        For NaN, which has no rank.
    """
    one = refuse_nan("values", values)
    other = refuse_nan("others", others)
    if len(one) < 3 or not np.ptp(one) or not np.ptp(other):
        return None
    # not by scipy.stats, whose import takes most of the time of `ssil-data show`
    return float(np.corrcoef(_rank(one), _rank(other))[1, 0])


def _rank(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rank of each value, from 1; equal values share the middle of theirs."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - (counts - 1) / 2)[place]


def partial_spearman(values: ArrayLike, others: ArrayLike, given: ArrayLike) -> float | None:
    """Return Spearman's rank correlation with the rank of a third quantity held constant.

    Parameters
    ----------
    values, others
        (n,) each, without NaN.
    given
        What is held constant, (n,).

    Returns
    -------
    float or None
        None where `spearman` is, or where `given` explains one of the two entirely.

    Raises
    ------
    InvalidInputError
        For NaN, which has no rank.

    Source
    ------
    Partial correlation of first order, (r_xy − r_xz r_yz) / ((1 − r_xz²)(1 − r_yz²))^½, of ranks.
    """
    held = refuse_nan("given", given)
    between = spearman(values, others)
    if between is None:
        return None
    to_values = spearman(values, held)
    to_others = spearman(others, held)
    if to_values is None or to_others is None:
        return between
    spread = np.sqrt((1 - to_values**2) * (1 - to_others**2))
    return float((between - to_values * to_others) / spread) if spread > 1e-12 else None


class _UnlabeledEpisodes:
    """The unlabeled episodes: their rows, lengths, tiers, true scores and mean leverage."""

    def __init__(self, episodes: pa.Table, leverage: NDArray[np.float32]) -> None:
        stops = np.cumsum(episodes["length"].to_numpy())
        pairs = int(stops[-1]) if len(stops) else 0
        if np.shape(leverage) != (pairs,):
            raise InvalidInputError(
                f"leverage: expected one number per pair, {pairs}, found shape {np.shape(leverage)}"
            )
        refuse_nan("leverage", leverage)
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
        return sorted({tier for tier in self.tier if tier is not None}, key=_tier_order)

    @property
    def negative(self) -> NDArray[np.int64]:
        """The episodes of a tier that is not the expert's."""
        return np.flatnonzero([tier not in (None, EXPERT) for tier in self.tier])

    def of_tier(self, tier: str) -> NDArray[np.int64]:
        """Return the episodes of a tier."""
        return np.flatnonzero(self.tier == tier)

    def pairs(self, chosen: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return the leverage of the pairs of some episodes."""
        rows = [slice(self.first[i], self.first[i] + self.length[i]) for i in chosen]
        return np.concatenate([self.leverage[:0], *(self.leverage[part] for part in rows)])

    def tier_mean(self, tier: str) -> float:
        """Return the mean leverage of the pairs of a tier."""
        return float(self.pairs(self.of_tier(tier)).mean(dtype=np.float64))

    def length_matched_auroc(self, expert: NDArray[np.int64], negative: NDArray[np.int64]) -> float:
        """Compare the first L steps of each negative episode with those of an expert episode.

        Expert episodes of at least that length take turns; where none is, both are cut to the
        longest.
        """
        high: list[NDArray[np.float32]] = []
        low: list[NDArray[np.float32]] = []
        longest = self.length[expert].max()
        for turn, index in enumerate(negative):
            steps = min(self.length[index], longest)
            able = expert[self.length[expert] >= steps]
            other = able[turn % len(able)]
            high.append(self.leverage[self.first[other] : self.first[other] + steps])
            low.append(self.leverage[self.first[index] : self.first[index] + steps])
        return auroc(np.concatenate(high), np.concatenate(low))


def _tier_order(tier: str) -> tuple[bool, float, str]:
    """Order tiers by the number they begin with, those without one after them, the expert last."""
    number = tier.split("-")[0]
    numbered = number.isascii() and number.isdecimal()
    return tier == EXPERT, float(number) if numbered else np.inf, tier
