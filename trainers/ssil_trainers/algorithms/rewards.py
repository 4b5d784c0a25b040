"""State rewards, which are added to the discriminator's: what GAIL, MixGAIL and SSIL differ in."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ssil_data.surface import FieldLike
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.cor_sharpness import auto_cor_alpha
from ssil_trainers.algorithms.demonstrations import Demonstrations

Shaping = Callable[[NDArray[np.float32]], NDArray[np.floating]]
"""Maps states (n, d) in raw units to rewards (n,); higher is better."""


def zero_reward(states: NDArray[np.float32]) -> NDArray[np.floating]:
    """Return 0 for every state: GAIL, which has the discriminator's reward alone.

    Parameters
    ----------
    states:
        States, (n, d).

    Examples
    --------
    >>> zero_reward(np.ones((3, 2), np.float32))
    array([0., 0., 0.])
    """
    return np.zeros(len(states))


def leverage_constraint_reward(field: FieldLike) -> Shaping:
    """Return LCoR as a state reward: SSIL.

    LCoR of a state is the leverage of the demonstrations near it: close to 1 where experts drive,
    close to 0 where only untrusted demonstrations are.

    Parameters
    ----------
    field:
        The leverage field of a scoring run.

    Notes
    -----
    Source: equation 5 of the SSIL paper.

    Examples
    --------
    >>> reward = leverage_constraint_reward(dataset.field("vae"))
    >>> states = dataset.pairs().states[:4]
    >>> bool((reward(states) == dataset.field("vae").lcor(states).values).all())
    True
    """
    return lambda states: field.lcor(states).values


def constraint_reward(field: FieldLike) -> Shaping:
    """Return CoR as a state reward: MixGAIL.

    CoR of a state is the share of labeled demonstrations among those near it: close to 1 near the
    labeled ones, close to 0 near the unlabeled ones.

    Parameters
    ----------
    field:
        The leverage field of a scoring run, of which only the labels and the kernel are used.

    Notes
    -----
    Source: equation 2 of the SSIL paper.

    Examples
    --------
    >>> reward = constraint_reward(dataset.field("vae"))
    >>> states = dataset.pairs().states
    >>> labeled = dataset.per_pair("labeled").astype(bool)
    >>> bool(reward(states[labeled]).mean() > reward(states[~labeled]).mean())
    True
    """
    return lambda states: field.cor(states)


def no_shaping(demonstrations: Demonstrations, settings: TrainSettings) -> Shaping:
    """Add nothing to the discriminator's reward (GAIL).

    Parameters
    ----------
    demonstrations:
        All pairs; unused.
    settings:
        Settings of the run; unused.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> no_shaping(demonstrations, TrainSettings())(states)
    array([0., 0., 0.])
    """
    return zero_reward


def shape_by_cor(demonstrations: Demonstrations, settings: TrainSettings) -> Shaping:
    """Add CoR, with the unlabeled states as the negative ones (MixGAIL).

    The sharpness of the kernel is CoR's own, whichever α a run has fitted for LCoR: without a run
    the reward is the same.

    Parameters
    ----------
    demonstrations:
        All pairs; the field of a run, if there is one, computes.
    settings:
        Settings of the run: `cor_alpha`.

    Raises
    ------
    InvalidInputError
        Unless some pairs are labeled and some are not.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> demonstrations = Demonstrations(states, states, labeled)
    >>> reward = shape_by_cor(demonstrations, TrainSettings())(states)
    >>> bool(reward[0] > reward[2])  # the first state is the labeled one
    True
    """
    alpha = choose_cor_alpha(demonstrations, settings)
    if demonstrations.field is not None:
        return constraint_reward(demonstrations.field.at(alpha))
    labeled = demonstrations.labeled.astype(np.float32)
    return constraint_reward(demonstrations.make_field(labeled, alpha))


def choose_cor_alpha(demonstrations: Demonstrations, settings: TrainSettings) -> float:
    """Return the sharpness of CoR: that of the settings, or fitted to the demonstrations.

    Parameters
    ----------
    demonstrations:
        All pairs.
    settings:
        Settings of the run: `cor_alpha`.

    Raises
    ------
    InvalidInputError
        Where it is fitted, unless some pairs are labeled and some are not.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> demonstrations = Demonstrations(states, states, np.array([True, False, False]))
    >>> choose_cor_alpha(demonstrations, TrainSettings(cor_alpha=2.0))
    2.0
    """
    if settings.cor_alpha != "auto":
        return float(settings.cor_alpha)
    standardized = demonstrations.standardizer(demonstrations.states)
    return auto_cor_alpha(standardized, demonstrations.labeled)


def shape_by_lcor(demonstrations: Demonstrations, settings: TrainSettings) -> Shaping:
    """Add LCoR (SSIL).

    Parameters
    ----------
    demonstrations:
        All pairs, with the leverage field of a run.
    settings:
        Settings of the run; unused.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> field = demonstrations.make_field(leverage, alpha=1.0)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage, field)
    >>> reward = shape_by_lcor(demonstrations, TrainSettings())(states)
    >>> bool(reward[0] > reward[1] > reward[2])
    True
    """
    return leverage_constraint_reward(demonstrations.require_field)


def shape_by_shuffled_lcor(demonstrations: Demonstrations, settings: TrainSettings) -> Shaping:
    """Add LCoR of the same leverage values, each given to another pair at random: a control.

    Parameters
    ----------
    demonstrations:
        All pairs, with the leverage and the field of a run.
    settings:
        Settings of the run, of which the seed shuffles.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> field = demonstrations.make_field(leverage, alpha=1.0)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage, field)
    >>> reward = shape_by_shuffled_lcor(demonstrations, TrainSettings())(states)
    >>> bool((reward >= 0).all() and (reward <= 1).all())
    True
    """
    alpha = demonstrations.require_field.alpha
    random = np.random.default_rng([settings.seed, 4])
    shuffled = random.permutation(demonstrations.require_leverage)
    return leverage_constraint_reward(demonstrations.make_field(shuffled, alpha))
