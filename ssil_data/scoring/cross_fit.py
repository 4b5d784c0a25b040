"""Cross-fitting: labeled pairs judged by estimators that were not fitted on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.estimators import Estimator, UnlabeledSample
from ssil_data.pooling import Pooling
from ssil_data.scoring.self_training import join_labeled

LEAST_PAIRS = 4
"""Labeled pairs below which there are no two halves to fit on."""


def rank_labeled(
    estimator: Estimator,
    pooling: Pooling,
    labeled: Pairs,
    *,
    unlabeled: UnlabeledSample,
    seed: int,
    joined: Pairs | None = None,
) -> NDArray[np.float64] | None:
    """Return what share of the unlabeled pairs is less uncertain than each labeled pair.

    Each half of the labeled pairs is judged by the estimator fitted on the other half.

    Parameters
    ----------
    estimator
        The settings to fit with.
    pooling
        How uncertainty is pooled over time.
    labeled
        The labeled pairs, (m,).
    unlabeled
        A sample of the unlabeled pairs.
    seed
        Of the fits.
    joined
        Pairs that are fitted on beside either half, and are judged by none: self-training chose
        them by the pool that they would be ranked in. None for none.

    Returns
    -------
    ndarray or None
        (m,), from 0 (as certain as the most certain unlabeled pair) to 1; None for fewer than
        `LEAST_PAIRS`.
    """
    if len(labeled) < LEAST_PAIRS:
        return None
    first = halve(labeled)
    ranks = np.empty(len(labeled))
    for half in (first, ~first):
        others_half = labeled.where(~half)
        known = others_half if joined is None else join_labeled(others_half, joined)
        fitted = estimator.fit(known, seed=seed, unlabeled=unlabeled)
        pool = unlabeled.pairs
        strange = fitted.uncertainty(pool).total
        pooled = pooling.fit(strange, pool.episode)
        judged = labeled.where(half)
        others = np.sort(pooled(strange, pool.episode))
        own = pooled(fitted.uncertainty(judged).total, judged.episode)
        below = np.searchsorted(others, own, side="left") + np.searchsorted(others, own, "right")
        ranks[half] = below / (2 * len(others))
    return ranks


def halve(labeled: Pairs) -> NDArray[np.bool_]:
    """Mark about half of the labeled pairs: every other episode, or the first half of the only one.

    Parameters
    ----------
    labeled
        At least two pairs, (m,).
    """
    episodes, number = np.unique(labeled.episode, return_inverse=True)
    if len(episodes) == 1:
        return np.arange(len(labeled)) < len(labeled) // 2
    return number % 2 == 0
