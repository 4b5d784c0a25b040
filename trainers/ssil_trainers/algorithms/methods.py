"""Each method: which pairs are expert data, and which state reward is added to −log D."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ssil_data.features import Standardizer
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.demonstrations import Demonstrations
from ssil_trainers.algorithms.expert_sampler import ExpertSampler, PairSampler
from ssil_trainers.algorithms.expert_weights import (
    Weights,
    imitate_all,
    imitate_by_leverage,
    imitate_by_shuffled_leverage,
    imitate_labeled,
)
from ssil_trainers.algorithms.half_labeled_sampler import HalfLabeledSampler, share_of_unlabeled
from ssil_trainers.algorithms.pair_rewards import PairReward, log_odds_reward
from ssil_trainers.algorithms.policy import ActionBox
from ssil_trainers.algorithms.rewards import (
    Shaping,
    choose_cor_alpha,
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
    "gail-shuffled",
    "shuffled",
    "constant",
    "clone",
    "clone-mixed",
    "clone-leverage",
    "clone-shuffled",
]
"""The names in `METHODS`, for the types of the command line; a test compares the two."""


@dataclass(frozen=True)
class Method:
    """One method: the weights of the expert pairs, the state reward, and settings it needs.

    Parameters
    ----------
    expert_weights:
        How much each pair is imitated. By leverage, shuffled or not, they are the weights of the
        unlabeled pairs among each other, which fill half of every batch at most.
    shaping:
        Makes the state reward from demonstrations and settings.
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
    shaping: Callable[[Demonstrations, TrainSettings], Shaping] = no_shaping
    fixed_settings: Mapping[str, Any] = field(default_factory=dict)

    @property
    def uses_run(self) -> bool:
        """Whether it uses a scoring run where one is named; MixGAIL lets its field compute CoR."""
        return self.half_labeled or self.shaping is not no_shaping

    @property
    def half_labeled(self) -> bool:
        """Whether it imitates by weight: half of every batch labeled, half unlabeled if enough."""
        return self.expert_weights in (imitate_by_leverage, imitate_by_shuffled_leverage)

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

    def complete(self, settings: TrainSettings, demonstrations: Demonstrations) -> TrainSettings:
        """Return the settings with a number in the place of what is fitted to demonstrations.

        Parameters
        ----------
        settings:
            Settings of a run; `cor_alpha` may be `auto`, which only MixGAIL fits.
        demonstrations:
            All pairs.
        """
        if self.shaping is not shape_by_cor:
            return settings
        return replace(settings, cor_alpha=choose_cor_alpha(demonstrations, settings))

    def pair_reward(
        self, demonstrations: Demonstrations, settings: TrainSettings
    ) -> PairReward | None:
        """Make the reward that sees the action; None where it is off, and for methods without LCoR.

        Parameters
        ----------
        demonstrations:
            All pairs, with the model of a run.
        settings:
            Settings of the run.
        """
        if settings.pair_reward == 0 or self.shaping is not shape_by_lcor:
            return None
        return log_odds_reward(demonstrations.require_model(), settings.odds_limit)

    def expert_sampler(
        self,
        demonstrations: Demonstrations,
        box: ActionBox,
        standardizer: Standardizer,
        *,
        settings: TrainSettings,
    ) -> PairSampler:
        """Select the expert pairs of the method and map them to the inputs of the networks.

        Where a method imitates by weight, half of every batch is labeled, and the other half is
        unlabeled as long as no unlabeled pair counts more than a labeled one by that. Where they
        are too few, labeled pairs are drawn alike, the heaviest unlabeled pair as one of them, and
        the others by their weights: without a weight above 0, labeled pairs alone.

        Parameters
        ----------
        demonstrations:
            All pairs.
        box:
            Range of the environment's actions.
        standardizer:
            Standardization of states.
        settings:
            Settings of the run.

        Returns
        -------
        :
            Draws the pairs of positive weight.
        """
        weights = np.asarray(self.expert_weights(demonstrations, settings), np.float32)

        def select(kept: NDArray[np.bool_], weights: NDArray[np.float32]) -> ExpertSampler:
            return ExpertSampler(
                states=standardizer(demonstrations.states[kept]),
                actions=box.to_unit(demonstrations.actions[kept]),
                weights=weights[kept],
            )

        if not self.half_labeled:
            return select(weights > 0, weights)
        labeled = demonstrations.labeled
        unlabeled = (weights > 0) & ~labeled
        if share_of_unlabeled(int(labeled.sum()), weights[unlabeled]) < 1 / 2:
            heaviest = weights[unlabeled].max(initial=0) or 1
            return select(labeled | unlabeled, np.where(labeled, heaviest, weights))
        return HalfLabeledSampler(
            select(labeled, np.ones_like(weights)), select(unlabeled, weights)
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
        "gail-shuffled": Method(imitate_by_shuffled_leverage),
        "shuffled": Method(imitate_labeled, shape_by_shuffled_lcor),
        "constant": Method(imitate_labeled, fixed_settings=_CONSTANT_REWARD),
        "clone": Method(imitate_labeled, fixed_settings=_CLONE_ONLY),
        "clone-mixed": Method(imitate_all, fixed_settings=_CLONE_ONLY),
        "clone-leverage": Method(imitate_by_leverage, fixed_settings=_CLONE_ONLY),
        "clone-shuffled": Method(imitate_by_shuffled_leverage, fixed_settings=_CLONE_ONLY),
    }
)
"""Every method by the name that the command uses."""
