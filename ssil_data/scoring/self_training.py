"""Self-training: the purest unlabeled pairs join the labeled ones once, if pure enough."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs

SHARE = 0.3
"""Of the expert's unlabeled pairs, the share that joins."""
PUREST = 0.95
"""Least mean leverage of those that join."""
MOST_PAIRS = 4096
"""Pairs that join at most."""


def choose_purest(
    leverage: NDArray[np.float32], labeled: NDArray[np.bool_]
) -> NDArray[np.bool_] | None:
    """Choose the unlabeled pairs of the highest leverage; None where they are not pure enough.

    A second round undoes what the first gains, and few labels choose badly: so there is one round,
    and only if the chosen pairs are expected to be the expert's.

    Parameters
    ----------
    leverage
        Chance that each pair is the expert's, (n,).
    labeled
        Which pairs are labeled, (n,).

    Returns
    -------
    ndarray or None
        Which pairs join, (n,).
    """
    expected = float(leverage[~labeled].sum(dtype=np.float64))
    count = int(min(SHARE * expected, MOST_PAIRS))
    if count < 2:
        return None
    order = np.argsort(np.where(labeled, -1.0, leverage), kind="stable")[::-1][:count]
    if leverage[order].mean(dtype=np.float64) < PUREST:
        return None
    chosen = np.zeros(len(leverage), dtype=bool)
    chosen[order] = True
    return chosen


def collect_pairs(batches: Iterable[Pairs], chosen: NDArray[np.bool_]) -> Pairs:
    """Read chosen pairs from a stream; where rows are skipped, another episode begins.

    Parameters
    ----------
    batches
        All pairs in order.
    chosen
        Which to read, (n,), at least one.
    """
    states = []
    actions = []
    rows = []
    episodes = []
    done = 0
    for batch in batches:
        kept = chosen[done : done + len(batch)]
        states.append(batch.states[kept])
        actions.append(batch.actions[kept])
        episodes.append(batch.episode[kept])
        rows.append(done + np.flatnonzero(kept))
        done += len(batch)
    row = np.concatenate(rows)
    episode = np.concatenate(episodes)
    starts = np.ones(len(row), dtype=bool)
    starts[1:] = (np.diff(row) != 1) | (np.diff(episode) != 0)
    first = np.maximum.accumulate(np.where(starts, np.arange(len(row)), 0))
    return Pairs(
        np.concatenate(states),
        np.concatenate(actions),
        episode=np.cumsum(starts) - 1,
        step=np.arange(len(row)) - first,
    )


def join_labeled(labeled: Pairs, chosen: Pairs) -> Pairs:
    """Return labeled and chosen pairs as one, as episodes of their own.

    Parameters
    ----------
    labeled, chosen
        The two.
    """
    last = int(labeled.episode.max())
    return Pairs(
        np.concatenate([labeled.states, chosen.states]),
        np.concatenate([labeled.actions, chosen.actions]),
        episode=np.concatenate([labeled.episode, chosen.episode + last + 1]),
        step=np.concatenate([labeled.step, chosen.step]),
    )
