"""How much a method imitates each pair: the weights of the expert pairs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.demonstrations import Demonstrations
from ssil_trainers.algorithms.odds import density_ratio

Weights = Callable[[Demonstrations, TrainSettings], NDArray[np.floating]]
"""Gives each pair a weight, (n,), at least 0, by the settings of the run."""

SURE = 0.95
"""Leverage from which a pair counts as surely the expert's: of pairs at it 19 in 20 are, where
leverage is a chance, so by the posterior scale."""


def imitate_labeled(
    demonstrations: Demonstrations, settings: TrainSettings
) -> NDArray[np.floating]:
    """Weight labeled pairs by 1 and unlabeled ones by 0.

    Parameters
    ----------
    demonstrations:
        All pairs.
    settings:
        Settings of the run; unused.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> imitate_labeled(demonstrations, TrainSettings())
    array([1., 0., 0.], dtype=float32)
    """
    return demonstrations.labeled.astype(np.float32)


def imitate_all(demonstrations: Demonstrations, settings: TrainSettings) -> NDArray[np.floating]:
    """Weight every pair by 1, as if all were expert data.

    Parameters
    ----------
    demonstrations:
        All pairs.
    settings:
        Settings of the run; unused.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> imitate_all(demonstrations, TrainSettings())
    array([1., 1., 1.], dtype=float32)
    """
    return np.ones(len(demonstrations.labeled), np.float32)


def imitate_by_leverage(
    demonstrations: Demonstrations, settings: TrainSettings
) -> NDArray[np.floating]:
    """Weight the pairs that are surely the expert's alike, or as `expert_weighting` says.

    Among the unlabeled pairs only, which fill half of every batch at most (`share_of_unlabeled`).
    A clone of experts and a few that are nearly as good drives like neither, so pairs in doubt
    count for nothing rather than for little.

    Parameters
    ----------
    demonstrations:
        All pairs, with their leverage.
    settings:
        Settings of the run: `expert_weighting` and `odds_limit`.

    Raises
    ------
    InvalidInputError
        Without a scoring run.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> imitate_by_leverage(demonstrations, TrainSettings())
    array([1., 0., 0.], dtype=float32)
    >>> imitate_by_leverage(demonstrations, TrainSettings(expert_weighting="posterior"))
    array([1. , 0.5, 0. ], dtype=float32)
    >>> imitate_by_leverage(demonstrations, TrainSettings(expert_weighting="ratio"))
    array([20.,  1.,  0.])
    """
    leverage = demonstrations.require_leverage
    if settings.expert_weighting == "ratio":
        return density_ratio(leverage, settings.odds_limit)
    if settings.expert_weighting == "posterior":
        return leverage
    return (leverage >= SURE).astype(np.float32)


def imitate_by_shuffled_leverage(
    demonstrations: Demonstrations, settings: TrainSettings
) -> NDArray[np.floating]:
    """Weight as by leverage, each unlabeled pair by the leverage of another at random: a control.

    The weights are the same numbers, so as many pairs count as much; only which ones is lost.

    Parameters
    ----------
    demonstrations:
        All pairs, with their leverage.
    settings:
        Settings of the run: `expert_weighting`, `odds_limit`, and the seed of the shuffling.

    Raises
    ------
    InvalidInputError
        Without a scoring run.

    Examples
    --------
    >>> states = np.arange(4, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.25, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> settings = TrainSettings(expert_weighting="posterior")
    >>> weights = imitate_by_shuffled_leverage(demonstrations, settings)
    >>> sorted(weights[1:].tolist())
    [0.0, 0.25, 0.5]
    """
    weights = imitate_by_leverage(demonstrations, settings).copy()
    unlabeled = np.flatnonzero(~demonstrations.labeled)
    rng = np.random.default_rng([settings.seed, 6])
    weights[unlabeled] = rng.permutation(weights[unlabeled])
    return weights
