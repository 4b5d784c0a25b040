"""How much a method imitates each pair: the weights of the expert pairs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ssil_trainers.algorithms.demonstrations import Demonstrations

Weights = Callable[[Demonstrations], NDArray[np.floating]]
"""Gives each pair a weight, (n,), at least 0."""


def imitate_labeled(demonstrations: Demonstrations) -> NDArray[np.floating]:
    """Weight labeled pairs by 1 and unlabeled ones by 0.

    Parameters
    ----------
    demonstrations:
        All pairs.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> imitate_labeled(demonstrations)
    array([1., 0., 0.], dtype=float32)
    """
    return demonstrations.labeled.astype(np.float32)


def imitate_all(demonstrations: Demonstrations) -> NDArray[np.floating]:
    """Weight every pair by 1, as if all were expert data.

    Parameters
    ----------
    demonstrations:
        All pairs.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> imitate_all(demonstrations)
    array([1., 1., 1.], dtype=float32)
    """
    return np.ones(len(demonstrations.labeled), np.float32)


def imitate_by_leverage(demonstrations: Demonstrations) -> NDArray[np.floating]:
    """Weight every pair by its leverage.

    Parameters
    ----------
    demonstrations:
        All pairs, with their leverage.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> imitate_by_leverage(demonstrations)
    array([1. , 0.5, 0. ], dtype=float32)
    """
    return demonstrations.require_leverage
