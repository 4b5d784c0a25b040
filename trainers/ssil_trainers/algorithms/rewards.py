"""State rewards, which are added to the discriminator's: what GAIL, MixGAIL and SSIL differ in."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ssil_data.surface import FieldLike

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
