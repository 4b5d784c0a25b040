"""The methods as rows of one table: whom they imitate, and what a state earns beside."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardizer
from ssil_data.field import LeverageField, auto_alpha
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.expert_sampler import ExpertSampler
from ssil_trainers.algorithms.policy import ActionBox
from ssil_trainers.algorithms.rewards import (
    Field,
    Shaping,
    constraint_reward,
    leverage_constraint_reward,
    zero_reward,
)


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """n pairs in raw units, which are labeled, and what a run says of them if there is one.

    states (n, d), actions (n, k), labeled (n,) bool, leverage (n,) or None, field or None.
    `threads`: of a field that is made here, None for all processors.
    """

    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    labeled: NDArray[np.bool_]
    leverage: NDArray[np.float32] | None = None
    field: Field | None = None
    threads: int | None = None

    def __post_init__(self) -> None:
        """Refuse unequal lengths, and demonstrations without a labeled pair."""
        lengths = {len(self.states), len(self.actions), len(self.labeled)}
        if len(lengths) > 1:
            raise InvalidInputError(f"demonstrations: expected equal lengths, found {lengths}")
        if not self.labeled.any():
            raise InvalidInputError("demonstrations: expected labeled pairs, found none")

    @property
    def standardizer(self) -> Standardizer:
        """The standardisation by all demonstrations."""
        return Standardizer.of(self.states)

    def field_of(self, leverage: NDArray[np.float32], alpha: float) -> LeverageField:
        """Return a field over these states, in this process, of leverage (n,)."""
        return LeverageField(
            self.states, leverage, self.labeled, self.standardizer, alpha, threads=self.threads
        )


Weights = Callable[[Demonstrations], NDArray[np.floating]]
"""How much each pair is imitated, (n,)."""


def imitate_labeled(of: Demonstrations) -> NDArray[np.floating]:
    """Imitate the labeled pairs alone."""
    return of.labeled.astype(np.float32)


def imitate_all(of: Demonstrations) -> NDArray[np.floating]:
    """Imitate every pair, whoever made it."""
    return np.ones(len(of.labeled), np.float32)


def imitate_by_leverage(of: Demonstrations) -> NDArray[np.floating]:
    """Imitate every pair as much as it is trusted."""
    if of.leverage is None:
        raise _NEEDS_RUN
    return of.leverage


def no_shaping(of: Demonstrations, seed: int) -> Shaping:
    """Pay zero_reward beside the discriminator's reward."""
    return zero_reward


def shape_by_cor(of: Demonstrations, seed: int) -> Shaping:
    """Pay CoR, with the unlabeled states as the negative ones; without a run, α is fitted here."""
    field = of.field
    if field is None:
        alpha = auto_alpha(of.standardizer(of.states))
        field = of.field_of(of.labeled.astype(np.float32), alpha)
    return constraint_reward(field)


def shape_by_lcor(of: Demonstrations, seed: int) -> Shaping:
    """Pay LCoR."""
    if of.field is None:
        raise _NEEDS_RUN
    return leverage_constraint_reward(of.field)


def shape_by_shuffled_lcor(of: Demonstrations, seed: int) -> Shaping:
    """Pay LCoR of the same leverage values, each given to another pair at random."""
    if of.field is None or of.leverage is None:
        raise _NEEDS_RUN
    mixed = np.random.default_rng([seed, 4]).permutation(of.leverage)
    return leverage_constraint_reward(of.field_of(mixed, of.field.alpha))


@dataclass(frozen=True)
class Method:
    """One row: the pairs imitated, the shaping, and the settings that make it what it is."""

    experts: Weights
    shaping: Callable[[Demonstrations, int], Shaping] = no_shaping
    fixed: Mapping[str, Any] = field(default_factory=dict)

    @property
    def takes_run(self) -> bool:
        """Whether a scoring run means anything to it."""
        return self.experts is imitate_by_leverage or self.shaping is not no_shaping

    @property
    def needs_run(self) -> bool:
        """Whether it asks for leverage; CoR knows which pairs are labeled and no more."""
        return self.takes_run and self.shaping is not shape_by_cor

    def settings(self, given: TrainSettings) -> TrainSettings:
        """Return the settings with those that make the method."""
        return replace(given, **self.fixed)

    def expert_sampler(
        self, of: Demonstrations, box: ActionBox, standardiser: Standardizer
    ) -> ExpertSampler:
        """Return the pairs imitated, as the networks see them."""
        weight = np.asarray(self.experts(of), np.float32)
        kept = weight > 0
        states, actions = standardiser(of.states[kept]), box.to_unit(of.actions[kept])
        return ExpertSampler(states, actions, weight[kept])


_CLONED = {"steps": 0, "pretrained": True}
_CONSTANT = {"discriminator_steps": 0, "spectral_norm": False}
"""A discriminator that learns zero_reward says ½ for ever: the reward is log 2 for every step."""

METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "gail": Method(imitate_labeled),
        "gail-mixed": Method(imitate_all),
        "mixgail": Method(imitate_labeled, shape_by_cor),
        "ssil": Method(imitate_labeled, shape_by_lcor),
        "gail-leverage": Method(imitate_by_leverage),
        "ssil-leverage": Method(imitate_by_leverage, shape_by_lcor),
        "shuffled": Method(imitate_labeled, shape_by_shuffled_lcor),
        "constant": Method(imitate_labeled, fixed=_CONSTANT),
        "clone": Method(imitate_labeled, fixed=_CLONED),
        "clone-mixed": Method(imitate_all, fixed=_CLONED),
        "clone-leverage": Method(imitate_by_leverage, fixed=_CLONED),
    }
)
"""Every method by the name that the command knows it by."""

_NEEDS_RUN = InvalidInputError("method: expected a run, whose leverage it asks for, found none")
