"""The split of labeled pairs into those to fit on and those held out.

A conformal scale is calibrated on the held-out ones; an MDN stops learning by them.
"""

from __future__ import annotations

import numpy as np

from ssil_data.demonstrations import Pairs


def split_held_out(labeled: Pairs, *, share: float, seed: int) -> tuple[Pairs, Pairs]:
    """Split labeled pairs by whole episodes; neighboring pairs are too alike to be split.

    Parameters
    ----------
    labeled
        The labeled pairs.
    share
        About what share of the pairs to hold out, between 0 and 1.
    seed
        Chooses the episodes. Of a single episode, its end is held out.

    Returns
    -------
    tuple of Pairs
        Those to fit on and those held out; neither is empty if there are two pairs.
    """
    episodes = np.unique(labeled.episode)
    if len(episodes) == 1:
        cut = len(labeled) - max(1, round(share * len(labeled)))
        return labeled[:cut], labeled[cut:]
    order = np.random.default_rng(seed).permutation(episodes)
    lengths = np.array([(labeled.episode == episode).sum() for episode in order])
    count = int(np.searchsorted(np.cumsum(lengths), share * len(labeled))) + 1
    held_out = np.isin(labeled.episode, order[: min(count, len(order) - 1)])
    return labeled.where(~held_out), labeled.where(held_out)
