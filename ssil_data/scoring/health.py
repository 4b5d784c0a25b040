"""How good a run can be: what it rests on, and reasons not to trust it. No true quality is read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.estimators import UnlabeledSample
from ssil_data.features import Standardizer
from ssil_data.scales import Chance, FittedScale
from ssil_data.scoring.poor_labels import FEWEST_PAIRS, ONE_EPISODE, find_poor_labels

LEAST_TOLD = 0.4
"""Least share of what perfect separation would tell held-out experts from the pool by."""
LEAST_PERFECT = 0.15
"""Perfect separation of a pool of few others is taken for no less than this beyond chance."""
LEAST_DEVIATION = 0.02
"""Leverage of the pool that deviates by less tells nothing."""
WIDEST = 0.95
"""Width of the expert share's interval from which on nothing is known of the share."""
ALONE = 0.8
"""Share of all deviation from the labeled states that one dimension may have."""
AT_BOUND = 0.005
"""Estimated shares of the expert's pairs below this, or above the rest, are at their bound."""
BINS = 10


@dataclass(frozen=True)
class Health:
    """What a run says of itself.

    Parameters
    ----------
    labeled_episodes
        Episodes that the labeled pairs are of.
    expert_share, expert_share_interval
        Estimated share of the expert's among the unlabeled pairs, and its 90 % interval; None for
        a scale that estimates none.
    effective_pairs
        Kish's effective number of unlabeled pairs, (Σl)² / Σl², with leverage l as weight.
    weight_on_experts
        Share of the weight that is expected on the expert's pairs, Σl² / Σl; None for a scale that
        gives no chances.
    calibration_error
        Mean absolute difference between leverage and the share of experts that the held-out
        labeled pairs speak for, over ten bins; smaller is better. None without them.
    held_out_auroc
        Chance that a labeled pair that was held out has more leverage than an unlabeled one; with a
        share π of experts among these, it is about 1 − π / 2 at best; .5 is chance.
    weak
        Reasons not to trust the run; none if there is nothing against it.
    """

    labeled_episodes: int
    expert_share: float | None
    expert_share_interval: tuple[float, float] | None
    effective_pairs: float
    weight_on_experts: float | None
    calibration_error: float | None
    held_out_auroc: float | None
    weak: tuple[str, ...]


def examine(
    leverage: NDArray[np.float32],
    scale: FittedScale,
    *,
    labeled: Pairs | None,
    held_out: NDArray[np.float32] | None,
    unlabeled: UnlabeledSample | None,
    doubts: Sequence[str] = (),
) -> Health:
    """Say how good a run can be.

    Parameters
    ----------
    leverage
        Of the unlabeled pairs, (n,).
    scale
        The fitted scale.
    labeled
        The labeled pairs; None where another run rests on them, which knows how good they are.
    held_out
        Leverage of labeled pairs that the estimator was not fitted on, (m,); None for none.
    unlabeled
        A sample of the unlabeled pairs; None for none.
    doubts
        Further reasons not to trust the run.

    Returns
    -------
    Health
        What is known, and the reasons against it.
    """
    weights = leverage.astype(np.float64)
    total = weights.sum()
    squares = np.square(weights).sum()
    chance = scale if isinstance(scale, Chance) else None
    auroc = _rank_held_out(held_out, leverage)
    error = None
    if chance is not None and held_out is not None and len(leverage):
        error = _measure_calibration(weights, held_out, chance.expert_share)
    reasons = []
    if labeled is not None:
        reasons += _find_few_labels(labeled, held_out, chance)
        if unlabeled is not None:
            reasons += find_poor_labels(labeled, unlabeled)
            reasons += _find_lone_dimension(labeled, unlabeled)
    reasons += _find_untold(auroc, chance)
    reasons += [*_find_flat(leverage, chance), *doubts]
    return Health(
        labeled_episodes=0 if labeled is None else len(np.unique(labeled.episode)),
        expert_share=None if chance is None else chance.expert_share,
        expert_share_interval=None if chance is None else (chance.interval[0], chance.interval[1]),
        effective_pairs=float(total**2 / squares) if squares else 0.0,
        weight_on_experts=float(squares / total) if chance is not None and total else None,
        calibration_error=error,
        held_out_auroc=auroc,
        weak=tuple(reasons),
    )


def _rank_held_out(
    held_out: NDArray[np.float32] | None, leverage: NDArray[np.float32]
) -> float | None:
    """Return the AUROC of held-out labeled pairs against unlabeled ones, ties half."""
    if held_out is None or not len(leverage):
        return None
    others = np.sort(leverage)
    below = np.searchsorted(others, held_out, "left") + np.searchsorted(others, held_out, "right")
    return float(below.mean() / (2 * len(others)))


def _measure_calibration(
    leverage: NDArray[np.float64], held_out: NDArray[np.float32], share: float
) -> float:
    """Compare leverage with π f_E / f_U over bins of about equal mass of unlabeled pairs."""
    edges = np.unique(np.quantile(leverage, np.linspace(0, 1, BINS + 1)[1:-1]))
    place = np.searchsorted(edges, leverage, side="right")
    count = np.bincount(place, minlength=len(edges) + 1)
    mean = np.bincount(place, leverage, len(edges) + 1) / np.maximum(count, 1)
    experts = np.bincount(np.searchsorted(edges, held_out, "right"), minlength=len(edges) + 1)
    mass = count / count.sum()
    implied = share * experts / experts.sum() / np.maximum(mass, 1e-12)
    return float(np.sum(mass * np.abs(np.minimum(implied, 1) - mean)))


def _find_few_labels(
    labeled: Pairs, held_out: NDArray[np.float32] | None, chance: Chance | None
) -> list[str]:
    """Say if there are too few labeled pairs, or they are all alike."""
    reasons = []
    if len(labeled) < FEWEST_PAIRS:
        reasons.append(f"{len(labeled)} labeled pairs: too few to know the expert by")
    if chance is not None and held_out is None:
        reasons.append("no labeled pair was held out, so nothing is known of unseen experts")
    if len(labeled) >= 2 and not np.ptp(labeled.states, axis=0).any():
        reasons.append("all labeled pairs have the same state")
    if len(np.unique(labeled.episode)) == 1:
        reasons.append(ONE_EPISODE)
    return reasons


def _find_untold(auroc: float | None, chance: Chance | None) -> list[str]:
    """Say if held-out experts get hardly more leverage than the pool, or the share is unknown."""
    reasons = []
    if auroc is not None:
        # a useless run may find that nearly all are experts: the fewest that may be count
        fewest = 0.0 if chance is None else chance.interval[0]
        perfect = max(0.5 * (1 - fewest), LEAST_PERFECT)
        if (auroc - 0.5) / perfect < LEAST_TOLD:
            reasons.append(f"held-out experts are not told from the pool (AUROC {auroc:.2f})")
    if chance is not None and chance.interval[1] - chance.interval[0] >= WIDEST:
        low, high = chance.interval
        reasons.append(f"the expert share may be anything from {low:.2f} to {high:.2f}")
    return reasons


def _find_flat(leverage: NDArray[np.float32], chance: Chance | None) -> list[str]:
    """Say if leverage is almost the same for all, or the share of experts is at its bound."""
    reasons = []
    if chance is not None and not AT_BOUND <= chance.expert_share <= 1 - AT_BOUND:
        reasons.append(f"the expert share, {chance.expert_share:.4f}, is at its bound")
    if not len(leverage):
        reasons.append("no pair is unlabeled, so there is nothing to compare with")
    elif len(leverage) < FEWEST_PAIRS:
        reasons.append(f"{len(leverage)} unlabeled pairs: too few to compare the expert with")
    if len(leverage) and leverage.std(dtype=np.float64) < LEAST_DEVIATION:
        middle = float(np.median(leverage))
        reasons.append(f"leverage hardly differs between unlabeled pairs (about {middle:.2f})")
    return reasons


def _find_lone_dimension(labeled: Pairs, unlabeled: UnlabeledSample) -> list[str]:
    """Say if one state dimension makes nearly all of the distance from the labeled states."""
    if labeled.states.shape[1] < 2:
        return []
    standardizer = Standardizer.of(labeled.states, least=unlabeled.least_state_scale)
    squares = np.square(standardizer(unlabeled.pairs.states).astype(np.float64)).mean(axis=0)
    share = squares / max(squares.sum(), 1e-300)
    most = int(share.argmax())
    if share[most] < ALONE:
        return []
    return [
        f"state dimension {most} decides alone: {share[most]:.0%} of all deviation from the "
        "labeled states"
    ]
