"""Rewards that a state earns beside the discriminator's: what GAIL, MixGAIL and SSIL differ in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

Shaping = Callable[[NDArray[np.float32]], NDArray[np.floating]]
"""From states (n, d) in raw units to a reward each, (n,)."""


class Answer(Protocol):
    """What a field answers; values are (n,)."""

    @property
    def values(self) -> NDArray[np.floating]:
        """LCoR of each state."""
        ...


class Field(Protocol):
    """A leverage field, in this process or behind a service."""

    @property
    def alpha(self) -> float:
        """The kernel's sharpness."""
        ...

    def lcor(self, states: ArrayLike, /) -> Answer:
        """Return LCoR (equation 5) of states (n, d)."""
        ...

    def cor(self, states: ArrayLike, /) -> NDArray[np.floating]:
        """Return CoR (equation 2) of states (n, d)."""
        ...


def zero_reward(states: NDArray[np.float32]) -> NDArray[np.floating]:
    """Return 0 for every state: GAIL."""
    return np.zeros(len(states))


def leverage_constraint_reward(field: Field) -> Shaping:
    """Return LCoR of a field as a shaping: SSIL."""
    return lambda states: field.lcor(states).values


def constraint_reward(field: Field) -> Shaping:
    """Return CoR of a field as a shaping: MixGAIL."""
    return lambda states: field.cor(states)
