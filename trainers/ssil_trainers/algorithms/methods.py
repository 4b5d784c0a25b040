"""Each method: which pairs are expert data, and which state reward is added to −log D."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from ssil_data.features import Standardizer
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.demonstrations import Demonstrations
from ssil_trainers.algorithms.expert_sampler import ExpertSampler
from ssil_trainers.algorithms.expert_weights import (
    Weights,
    imitate_all,
    imitate_by_leverage,
    imitate_labeled,
)
from ssil_trainers.algorithms.policy import ActionBox
from ssil_trainers.algorithms.rewards import (
    Shaping,
    no_shaping,
    shape_by_cor,
    shape_by_lcor,
    shape_by_shuffled_lcor,
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
