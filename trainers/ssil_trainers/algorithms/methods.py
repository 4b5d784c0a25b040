"""Each method: which pairs are expert data, and which state reward is added to −log D."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardizer
from ssil_data.field import LeverageField, auto_alpha
from ssil_data.surface import FieldLike
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.expert_sampler import ExpertSampler
from ssil_trainers.algorithms.policy import ActionBox
from ssil_trainers.algorithms.rewards import (
    Shaping,
    constraint_reward,
    leverage_constraint_reward,
    zero_reward,
)

MethodName = Literal[
    "gail",
    "gail-mixed",
    "mixgail",
    "ssil",
    "gail-leverage",
    "ssil-leverage",
    "shuffled",
    "constant",
    "clone",
    "clone-mixed",
    "clone-leverage",
]
"""The names in `METHODS`, for the types of the command line; a test compares the two."""


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """The pairs to learn from, which of them are labeled, and the leverage of a scoring run.

    Parameters
    ----------
    states:
        States, (n, d), in raw units.
    actions:
        Actions, (n, k), in raw units.
    labeled:
        Which pairs are labeled as expert demonstrations, (n,); at least one.
    leverage:
        Leverage of each pair by a scoring run, (n,), 1 for expert-like; None without a run.
    field:
        The leverage field of that run; None without a run.
    threads:
        Threads of a field that is made from these demonstrations; None for all processors.

    Raises
    ------
    InvalidInputError
        For unequal lengths, or without a labeled pair.

    Examples
    --------
    >>> states = np.arange(4, dtype=np.float32)[:, None]
    >>> demonstrations = Demonstrations(states, -states, np.array([True, True, False, False]))
    >>> demonstrations.standardizer.shift
    array([1.5], dtype=float32)
    """

    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    labeled: NDArray[np.bool_]
    leverage: NDArray[np.float32] | None = None
    field: FieldLike | None = None
    threads: int | None = None

    def __post_init__(self) -> None:
        """Refuse unequal lengths, and demonstrations without a labeled pair."""
        lengths = (len(self.states), len(self.actions), len(self.labeled))
        if len(set(lengths)) > 1:
            raise InvalidInputError(
                f"demonstrations: states, actions and labels differ in length: {lengths}"
            )
        if not self.labeled.any():
            raise InvalidInputError("demonstrations: no pair is labeled; label at least one")

    @property
    def standardizer(self) -> Standardizer:
        """The standardization of states by all demonstrations."""
        return Standardizer.of(self.states)

    def make_field(self, leverage: NDArray[np.float32], alpha: float) -> LeverageField:
        """Make a leverage field over these states in this process.

        Parameters
        ----------
        leverage:
            Leverage of each pair, (n,).
        alpha:
            Sharpness of the kernel, above 0.
        """
        return LeverageField(
            self.states, leverage, self.labeled, self.standardizer, alpha, threads=self.threads
        )


Weights = Callable[[Demonstrations], NDArray[np.floating]]
"""How much each pair is imitated, (n,), at least 0."""


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
    if demonstrations.leverage is None:
        raise _MISSING_RUN
    return demonstrations.leverage


def no_shaping(demonstrations: Demonstrations, seed: int) -> Shaping:
    """Add nothing to the discriminator's reward (GAIL).

    Parameters
    ----------
    demonstrations:
        All pairs; unused.
    seed:
        Seed of the run; unused.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> no_shaping(demonstrations, 0)(states)
    array([0., 0., 0.])
    """
    return zero_reward


def shape_by_cor(demonstrations: Demonstrations, seed: int) -> Shaping:
    """Add CoR, with the unlabeled states as the negative ones (MixGAIL).

    Without a run, the sharpness of the kernel is fitted to the demonstrations here.

    Parameters
    ----------
    demonstrations:
        All pairs, with the leverage field of a run.
    seed:
        Seed of the run; unused.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> field = demonstrations.make_field(leverage, alpha=1.0)
    >>> demonstrations = replace(demonstrations, field=field)
    >>> reward = shape_by_cor(demonstrations, 0)(states)
    >>> bool(reward[0] > reward[2])  # the first state is the labeled one
    True
    """
    field = demonstrations.field
    if field is None:
        alpha = auto_alpha(demonstrations.standardizer(demonstrations.states))
        field = demonstrations.make_field(demonstrations.labeled.astype(np.float32), alpha)
    return constraint_reward(field)


def shape_by_lcor(demonstrations: Demonstrations, seed: int) -> Shaping:
    """Add LCoR (SSIL).

    Parameters
    ----------
    demonstrations:
        All pairs, with the leverage field of a run.
    seed:
        Seed of the run; unused.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> field = demonstrations.make_field(leverage, alpha=1.0)
    >>> demonstrations = replace(demonstrations, field=field)
    >>> reward = shape_by_lcor(demonstrations, 0)(states)
    >>> bool(reward[0] > reward[1] > reward[2])
    True
    """
    if demonstrations.field is None:
        raise _MISSING_RUN
    return leverage_constraint_reward(demonstrations.field)


def shape_by_shuffled_lcor(demonstrations: Demonstrations, seed: int) -> Shaping:
    """Add LCoR of the same leverage values, each given to another pair at random: a control.

    Parameters
    ----------
    demonstrations:
        All pairs, with the leverage and the field of a run.
    seed:
        Seed of the shuffling.

    Examples
    --------
    >>> states = np.arange(3, dtype=np.float32)[:, None]
    >>> labeled = np.array([True, False, False])
    >>> leverage = np.array([1.0, 0.5, 0.0], np.float32)
    >>> demonstrations = Demonstrations(states, states, labeled, leverage)
    >>> field = demonstrations.make_field(leverage, alpha=1.0)
    >>> demonstrations = replace(demonstrations, field=field)
    >>> reward = shape_by_shuffled_lcor(demonstrations, 0)(states)
    >>> bool((reward >= 0).all() and (reward <= 1).all())
    True
    """
    field = demonstrations.field
    if field is None or demonstrations.leverage is None:
        raise _MISSING_RUN
    shuffled = np.random.default_rng([seed, 4]).permutation(demonstrations.leverage)
    return leverage_constraint_reward(demonstrations.make_field(shuffled, field.alpha))


@dataclass(frozen=True)
class Method:
    """One method: the weights of the expert pairs, the state reward, and settings it needs.

    Parameters
    ----------
    expert_weights:
        How much each pair is imitated.
    shaping:
        Makes the state reward from demonstrations and a seed.
    fixed_settings:
        Settings without which the method would be another one, by name.

    Examples
    --------
    >>> METHODS["ssil"].requires_run, METHODS["mixgail"].requires_run
    (True, False)
    >>> METHODS["clone"].override(TrainSettings()).iterations  # nothing after cloning
    0
    """

    expert_weights: Weights
    shaping: Callable[[Demonstrations, int], Shaping] = no_shaping
    fixed_settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def uses_run(self) -> bool:
        """Whether a scoring run changes the result."""
        return self.expert_weights is imitate_by_leverage or self.shaping is not no_shaping

    @property
    def requires_run(self) -> bool:
        """Whether it needs leverage. CoR needs only the labels, so MixGAIL works without a run."""
        return self.uses_run and self.shaping is not shape_by_cor

    def override(self, settings: TrainSettings) -> TrainSettings:
        """Return the settings with the method's own in place of the given ones.

        Parameters
        ----------
        settings:
            Settings of a run.
        """
        return replace(settings, **self.fixed_settings)

    def expert_sampler(
        self, demonstrations: Demonstrations, box: ActionBox, standardizer: Standardizer
    ) -> ExpertSampler:
        """Select the expert pairs of the method and map them to the inputs of the networks.

        Parameters
        ----------
        demonstrations:
            All pairs.
        box:
            Range of the environment's actions.
        standardizer:
            Standardization of states.

        Returns
        -------
        :
            The pairs of positive weight.
        """
        weights = np.asarray(self.expert_weights(demonstrations), np.float32)
        kept = weights > 0
        return ExpertSampler(
            states=standardizer(demonstrations.states[kept]),
            actions=box.to_unit(demonstrations.actions[kept]),
            weights=weights[kept],
        )


_CLONE_ONLY = {"steps": 0, "pretrained": True}
_CONSTANT_REWARD = {"discriminator_steps": 0, "spectral_norm": False}
"""A discriminator that is never trained says ½ everywhere: the reward is log 2 at every step."""

METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "gail": Method(imitate_labeled),
        "gail-mixed": Method(imitate_all),
        "mixgail": Method(imitate_labeled, shape_by_cor),
        "ssil": Method(imitate_labeled, shape_by_lcor),
        "gail-leverage": Method(imitate_by_leverage),
        "ssil-leverage": Method(imitate_by_leverage, shape_by_lcor),
        "shuffled": Method(imitate_labeled, shape_by_shuffled_lcor),
        "constant": Method(imitate_labeled, fixed_settings=_CONSTANT_REWARD),
        "clone": Method(imitate_labeled, fixed_settings=_CLONE_ONLY),
        "clone-mixed": Method(imitate_all, fixed_settings=_CLONE_ONLY),
        "clone-leverage": Method(imitate_by_leverage, fixed_settings=_CLONE_ONLY),
    }
)
"""Every method by the name that the command uses."""

_MISSING_RUN = InvalidInputError("method: needs the leverage of a scoring run; name one")
