"""A share of experts that was stated, beside the one that the data speak for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ssil_data.scales import Posterior, Scale
from ssil_data.scoring.health import WIDEST

FARTHEST_ODDS = 2.0
"""A stated share may be outside of the estimated interval by so many times the odds."""


def find_misfit(
    scale: Scale,
    pool: NDArray[np.float32],
    held_out: NDArray[np.float32] | None,
    *,
    stretch: int,
) -> list[str]:
    """Say if a stated share of experts is far from all that would be estimated, or unchecked.

    Parameters
    ----------
    scale
        Settings of the scale; only a posterior one whose share is stated can misfit.
    pool
        Pooled uncertainty of the unlabeled pairs, (n,).
    held_out
        Pooled uncertainty of labeled pairs held out, (m,); None for none.
    stretch
        About how many neighboring pairs one value rests on.

    Returns
    -------
    list of str
        The reason, which names both numbers; none if there is nothing against the share.
    """
    if not isinstance(scale, Posterior) or scale.expert_share is None:
        return []
    stated = scale.expert_share
    estimated = replace(scale, expert_share=None).fit(pool, held_out, stretch=stretch)
    low, high = estimated.interval
    if high - low >= WIDEST:
        return [
            f"the stated expert share, {stated:.4g}, cannot be checked: the data speak for "
            f"anything from {low:.2f} to {high:.2f}, and leverage follows what was stated"
        ]
    too_small = _odds(stated) * FARTHEST_ODDS < _odds(low)
    too_large = _odds(stated) > _odds(high) * FARTHEST_ODDS
    if not too_small and not too_large:
        return []
    return [
        f"the stated expert share, {stated:.4g}, does not fit the data, which speak for "
        f"{estimated.expert_share:.4g} (90 % interval {low:.4g} to {high:.4g})"
    ]


def _odds(share: float) -> float:
    return share / (1 - share) if share < 1 else np.inf
