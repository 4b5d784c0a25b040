"""Contrast: a pair is unusual where a classifier tells it from the labeled pairs.

The classifier learns from labeled pairs and from the unlabeled ones, some of which are the
expert's too: learning from positive and unlabeled data. It judges the state and the action at
once, and it is the only estimator here that needs unlabeled pairs to be fitted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.errors import InvalidInputError
from ssil_data.estimators.base import (
    Estimator,
    Fitted,
    Uncertainty,
    apply_in_blocks,
    check_equal,
    check_fit_input,
)
from ssil_data.estimators.perceptron import Perceptron
from ssil_data.estimators.unlabeled import UnlabeledSample, clip_outliers
from ssil_data.features import Standardizer

FAR = 20.0
"""Deviations from the pairs of the fit beyond which the network knows nothing."""


@dataclass(frozen=True)
class Contrast(Estimator):
    """Classifier of labeled against unlabeled pairs (positive–unlabeled): larger = stranger.

    The uncertainty is minus the classifier's logit of a pair being the expert's; larger = less
    like the labeled pairs, and it may be negative. Pairs of another dataset are judged by what
    told the expert from the unlabeled pairs that it was fitted with. Beyond `FAR` deviations from
    all of these it would guess, so each further deviation adds 1.

    Parameters
    ----------
    expert_share
        The share of expert pairs among the unlabeled ones that it assumes, below 1.
    hidden
        Width of the one hidden layer.
    gradient_penalty
        Weight of (max(0, ‖∇ logit‖ − 1))² between labeled and unlabeled pairs: it keeps the
        classifier from learning few labels by heart.
    steps
        Steps of Adam, at a rate that falls to zero.
    batch
        Labeled pairs, and as many unlabeled ones, drawn for each step.
    rate
        Learning rate of the first step.

    Raises
    ------
    InvalidInputError
        For a number that is not positive and finite, or not whole where it counts something, or a
        share of 1 or more.

    Source
    ------
    Kiryo et al., Positive-Unlabeled Learning with Non-Negative Risk Estimator, 2017; as a weight
    of imitation: Xu et al., Discriminator-Weighted Offline Imitation Learning, 2022.

    Examples
    --------
    >>> unlabeled = sd.UnlabeledSample.of(dataset.pairs()[120:])
    >>> fitted = sd.Contrast(steps=20).fit(dataset.labeled(), seed=0, unlabeled=unlabeled)
    >>> fitted.uncertainty(dataset.pairs()).total.shape == (len(dataset),)
    True
    """

    kind: ClassVar[str] = "contrast"
    expert_share: float = 0.1
    hidden: int = 128
    gradient_penalty: float = 0.1
    steps: int = 400
    batch: int = 256
    rate: float = 4e-3

    def __post_init__(self) -> None:
        """Validate the settings."""
        super().__post_init__()
        if self.expert_share >= 1:
            raise InvalidInputError(
                f"contrast: expert_share: expected a number below 1, found {self.expert_share}"
            )

    @property
    def needs_unlabeled(self) -> bool:
        """Whether it is fitted on unlabeled pairs too: it is."""
        return True

    def fit(
        self, labeled: Pairs, *, seed: int, unlabeled: UnlabeledSample | None = None
    ) -> FittedContrast:
        """Fit to labeled and unlabeled pairs, standardized by all of them.

        Parameters
        ----------
        labeled
            Expert pairs, two at least.
        seed
            Sets the first weights and draws the batches. Same seed, same machine, same result.
        unlabeled
            A sample of the unlabeled pairs.

        Returns
        -------
        FittedContrast
            The fitted estimator.

        Raises
        ------
        InvalidInputError
            Without unlabeled pairs, for fewer than two labeled ones or a seed outside 0 to
            2^63 − 1.
        """
        from ssil_data.estimators.learning import classifier

        check_fit_input(labeled, seed)
        if unlabeled is None:
            raise InvalidInputError(
                "contrast: needs unlabeled pairs, and every pair is labeled; choose another "
                "estimator, such as windowvae"
            )
        ours = _join_columns(labeled)
        others = _join_columns(unlabeled.pairs)
        standardizer = Standardizer.of(clip_outliers(np.concatenate([ours, others])))
        return FittedContrast(
            settings=self,
            state_width=labeled.states.shape[1],
            action_width=labeled.actions.shape[1],
            standardizer=standardizer,
            network=classifier.learn(
                np.clip(standardizer(ours), -FAR, FAR),
                np.clip(standardizer(others), -FAR, FAR),
                share=self.expert_share,
                hidden=self.hidden,
                gradient_penalty=self.gradient_penalty,
                steps=self.steps,
                batch=self.batch,
                rate=self.rate,
                seed=seed,
            ),
        )


@dataclass(frozen=True, eq=False)
class FittedContrast(Fitted):
    """r = −logit of a pair being the expert's.

    Parameters
    ----------
    settings
        What it was fitted with.
    standardizer
        Standardizes states and actions side by side, (d + k,).
    network
        Standardized pair (d + k) → logit (1).
    """

    settings: Contrast
    standardizer: Standardizer
    network: Perceptron

    def __post_init__(self) -> None:
        """Validate that the parts fit the widths."""
        width = self.state_width + self.action_width
        check_equal("standardizer", self.standardizer.width, width)
        check_equal("network", self.network.widths, (width, 1))

    def _uncertainty(self, pairs: Pairs) -> Uncertainty:
        def judge(states: NDArray[np.float32], actions: NDArray[np.float32]) -> NDArray[np.float32]:
            standard = self.standardizer(np.concatenate([states, actions], axis=1))
            excess = np.maximum(np.abs(standard).max(axis=1) - np.float32(FAR), 0)
            return excess - self.network(np.clip(standard, -FAR, FAR))[:, 0]

        return Uncertainty(apply_in_blocks(judge, pairs.states, pairs.actions), {})


def _join_columns(pairs: Pairs) -> NDArray[np.float32]:
    """Return states and actions side by side, (n, d + k)."""
    return np.concatenate([pairs.states, pairs.actions], axis=1)
