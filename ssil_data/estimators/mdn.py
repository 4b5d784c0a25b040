"""MDN: a pair is unusual where a mixture of experts' actions is wide or divided.

Both depend on the state alone, and the network learns them only where experts have been: a wrong
action in a familiar state looks perfect, and so may an unfamiliar state. `surprisal` judges the
action that was taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.estimators.base import (
    Estimator,
    Fitted,
    Uncertainty,
    apply_in_blocks,
    check_equal,
    check_fit_input,
)
from ssil_data.estimators.label_split import split_held_out
from ssil_data.estimators.perceptron import Perceptron
from ssil_data.estimators.unlabeled import UnlabeledSample, standardize_pairs
from ssil_data.features import Standardizer

if TYPE_CHECKING:
    from ssil_data.estimators.learning.mixture import MixtureLearner

HELD_OUT = 0.2
"""About what share of the labeled pairs is held out to stop by."""


@dataclass(frozen=True)
class MDN(Estimator):
    """Mixture density network of the expert's action: uncertain = wide or divided.

    State → mixture of `components` normal actions. The uncertainty is the variance of the mixture,
    within its components (aleatoric) and between them (epistemic); larger = less sure of the
    expert's action.

    Parameters
    ----------
    components
        Normal distributions in the mixture.
    hidden
        Width of the one hidden layer.
    floor
        Least variance of a component, as a share of the action's variance.
    steps
        Steps of Adam, at a rate that falls to zero.
    batch
        Labeled pairs drawn for each step.
    rate
        Learning rate of the first step.
    surprisal
        Judge the action that was taken, −log p(a | s) of the standardized action in nats, which
        may be negative, instead of the variances. An extension of the paper.
    stop_early
        Hold out a fifth of the labeled pairs by whole episodes (of a single one, its end), find the
        step at which their actions are likeliest, and train on all labeled pairs up to that step,
        with the same rates. Off, all steps are taken, as in the first version.

    Raises
    ------
    InvalidInputError
        For a number that is not positive and finite, or not whole where it counts something.

    Source
    ------
    Bishop, Mixture Density Networks, 1994.

    Examples
    --------
    >>> fitted = sd.MDN(steps=20, surprisal=True).fit(dataset.labeled(), seed=0)
    >>> sorted(fitted.uncertainty(dataset.pairs()).parts)
    ['aleatoric', 'epistemic']
    """

    kind: ClassVar[str] = "mdn"
    added: ClassVar[frozenset[str]] = frozenset({"stop_early"})
    components: int = 5
    hidden: int = 64
    floor: float = 0.1
    steps: int = 300
    batch: int = 256
    rate: float = 3e-3
    surprisal: bool = False
    stop_early: bool = False

    def fit(
        self, labeled: Pairs, *, seed: int, unlabeled: UnlabeledSample | None = None
    ) -> FittedMDN:
        """Fit to the labeled pairs, standardized by their own mean and deviation.

        Parameters
        ----------
        labeled
            Expert pairs, two at least.
        seed
            Sets the first weights and draws the batches. Same seed, same machine, same result.
        unlabeled
            A sample of the unlabeled pairs, for the least scale of a dimension; None for none.

        Returns
        -------
        FittedMDN
            The fitted estimator.

        Raises
        ------
        InvalidInputError
            For fewer than two pairs or a seed outside 0 to 2^63 − 1.
        """
        from ssil_data.estimators.learning.mixture import MixtureLearner

        check_fit_input(labeled, seed)
        learner = MixtureLearner(
            components=self.components,
            hidden=self.hidden,
            floor=self.floor,
            steps=self.steps,
            batch=self.batch,
            rate=self.rate,
            seed=seed,
        )
        last = _find_best_step(learner, labeled, unlabeled, seed=seed) if self.stop_early else None
        states, actions = standardize_pairs(labeled, unlabeled)
        return FittedMDN(
            settings=self,
            state_width=labeled.states.shape[1],
            action_width=labeled.actions.shape[1],
            states=states,
            actions=actions,
            network=learner.learn(states(labeled.states), actions(labeled.actions), last=last),
        )


def _find_best_step(
    learner: MixtureLearner, labeled: Pairs, unlabeled: UnlabeledSample | None, *, seed: int
) -> int:
    """Return the step at which a part of the labeled pairs that is held out is likeliest."""
    kept, held_out = split_held_out(labeled, share=HELD_OUT, seed=seed)
    states, actions = standardize_pairs(kept, unlabeled)
    return learner.find_best_step(
        states(kept.states),
        actions(kept.actions),
        held_out=(states(held_out.states), actions(held_out.actions)),
    )


@dataclass(frozen=True, eq=False)
class Mixture:
    """Mixtures of K normal actions in n states.

    Parameters
    ----------
    weights
        Of the components (n, K); rows sum to 1.
    means
        Of the standardized action, (n, K, k).
    variances
        Of each action dimension, (n, K, k).
    """

    weights: NDArray[np.float32]
    means: NDArray[np.float32]
    variances: NDArray[np.float32]

    def aleatoric(self) -> NDArray[np.float32]:
        """Return the variance within the components, Σ_k π_k σ_k² (n,) (paper).

        It is summed over action dimensions; larger = experts act less uniformly here.
        """
        return np.einsum("nk,nka->n", self.weights, self.variances)

    def epistemic(self) -> NDArray[np.float32]:
        """Return the variance between the components, Σ_k π_k ‖μ_k − Σ_j π_j μ_j‖² (n,) (paper).

        Larger = the components disagree.
        """
        centered = self.means - np.einsum("nk,nka->na", self.weights, self.means)[:, None]
        return np.einsum("nk,nka->n", self.weights, np.square(centered))

    def surprisal(self, actions: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return −log Σ_k π_k N(a; μ_k, σ_k²) in nats; larger = the action was less expected.

        Parameters
        ----------
        actions
            The standardized actions that were taken, (n, k).

        Returns
        -------
        ndarray
            The surprisal (n,), which may be negative.
        """
        distance = np.square(actions[:, None] - self.means) / self.variances
        log_density = -(distance + np.log(2 * np.pi * self.variances)).sum(axis=2) / 2
        with np.errstate(divide="ignore"):
            log_joint = np.log(self.weights) + log_density
        most = log_joint.max(axis=1, keepdims=True)
        return -(most[:, 0] + np.log(np.exp(log_joint - most).sum(axis=1)))


@dataclass(frozen=True, eq=False)
class FittedMDN(Fitted):
    """r = aleatoric + epistemic variance of the standardized action (paper).

    Parameters
    ----------
    settings
        What it was fitted with.
    states, actions
        Standardize states (d,) and actions (k,) by the labeled pairs.
    network
        State (d) → logits (K), means (K·k), log variances (K·k).
    """

    settings: MDN
    states: Standardizer
    actions: Standardizer
    network: Perceptron

    def __post_init__(self) -> None:
        """Validate that the parts fit the settings and the widths."""
        outputs = self.settings.components * (1 + 2 * self.action_width)
        check_equal("states", self.states.width, self.state_width)
        check_equal("actions", self.actions.width, self.action_width)
        check_equal("network", self.network.widths, (self.state_width, outputs))

    def mixture(self, states: NDArray[np.float32]) -> Mixture:
        """Return the actions that experts may take in a state.

        Parameters
        ----------
        states
            Raw states (n, d).

        Returns
        -------
        Mixture
            The mixtures of standardized actions.
        """
        count = self.settings.components
        width = self.action_width
        raw = self.network(self.states(states))
        logits, means, log_variances = np.split(raw, [count, count * (1 + width)], axis=1)
        weights = np.exp(logits - logits.max(axis=1, keepdims=True))
        weights /= weights.sum(axis=1, keepdims=True)
        shape = (-1, count, width)
        variances = np.exp(log_variances.reshape(shape)) + np.float32(self.settings.floor)
        return Mixture(weights, means.reshape(shape), variances)

    def _uncertainty(self, pairs: Pairs) -> Uncertainty:
        def judge(states: NDArray[np.float32], actions: NDArray[np.float32]) -> NDArray[np.float32]:
            mixture = self.mixture(states)
            aleatoric = mixture.aleatoric()
            epistemic = mixture.epistemic()
            total = aleatoric + epistemic
            if self.settings.surprisal:
                total = mixture.surprisal(self.actions(actions))
            return np.column_stack([total, aleatoric, epistemic])

        total, aleatoric, epistemic = apply_in_blocks(judge, pairs.states, pairs.actions).T.copy()
        return Uncertainty(total, {"aleatoric": aleatoric, "epistemic": epistemic})
