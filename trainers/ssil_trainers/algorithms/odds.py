"""The odds of leverage: a weight for pairs to imitate, and a reward for pairs that are visited.

Where leverage w is the probability that an unlabeled pair is an expert's, w = π f_E / f with the
share π of experts, their density f_E and the pool's f, its odds are the density ratio of experts to
others up to a constant: w / (1 − w) = π f_E / ((1 − π) f_O).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def density_ratio(leverage: NDArray[np.floating], odds_limit: float) -> NDArray[np.float64]:
    """Return the odds of leverage, w / (1 − w), at most the limit; higher is more expert-like.

    Drawing the pool by w gives the experts' own density; drawing it by the odds prefers, among
    pairs like the experts', those that others hardly ever have.

    Parameters
    ----------
    leverage:
        Leverage w, (n,), from 0 to 1.
    odds_limit:
        The largest odds, above 1: what a pair of leverage 1 gets.

    Examples
    --------
    >>> density_ratio(np.array([0.0, 0.5, 0.75, 1.0]), odds_limit=20).round(6)
    array([ 0.,  1.,  3., 20.])
    """
    w = np.asarray(leverage, np.float64)
    # Where w / (1 − w) would be above the limit, w / limit is above 1 − w.
    return w / np.maximum(1 - w, w / odds_limit)


def log_odds(leverage: NDArray[np.floating], odds_limit: float) -> NDArray[np.float64]:
    """Return log(w / (1 − w)), above 0 for what is an expert's more likely than not.

    Parameters
    ----------
    leverage:
        Leverage w, (n,), from 0 to 1.
    odds_limit:
        The largest odds, above 1; the smallest are one over it. Leverage of exactly 0 or 1, which
        scales give to whole tails, stays finite by it.

    Returns
    -------
    :
        (n,), from −log(limit) to log(limit).

    Examples
    --------
    >>> log_odds(np.array([0.0, 0.5, 0.75, 1.0]), odds_limit=20).round(3)
    array([-2.996,  0.   ,  1.099,  2.996])
    """
    w = np.asarray(leverage, np.float64)
    least = 1 / (1 + odds_limit)
    inside = np.clip(w, least, 1 - least)
    return np.log(inside) - np.log1p(-inside)
