"""MDN: a pair is strange where a mixture of experts' actions is wide or divided.

Both depend on the state alone, and the network learns them only where experts have been: a wrong
action in a familiar state looks perfect, and so may an unfamiliar state. `surprisal` judges the
action that was taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.estimators.base import (
    Estimator,
    Fitted,
    Uncertainty,
    apply_in_blocks,
    expect,
    refuse_unfit,
)
from ssil_data.estimators.perceptron import Perceptron
from ssil_data.features import Standardizer


@dataclass(frozen=True)
class MDN(Estimator):
    """Mixture density network, state → mixture of `components` normal actions.

    `floor` is the least variance of a component, as a share of the action's variance; `hidden`,
    `steps`, `batch` and `rate` are as in the VAE. `surprisal`: −log p(a | s) of the standardised
    action, in nats, instead of the variances (an extension of the paper); it may be negative.
    """

    kind: ClassVar[str] = "mdn"
    components: int = 5
    hidden: int = 64
    floor: float = 0.1
    steps: int = 300
    batch: int = 256
    rate: float = 3e-3
    surprisal: bool = False

    def fit(self, labeled: Pairs, *, seed: int) -> FittedMDN:
        """Fit to the labeled pairs, standardised by their own mean and deviation."""
        from ssil_data.estimators.learning import mixture

        refuse_unfit(labeled, seed)
        states, actions = Standardizer.of(labeled.states), Standardizer.of(labeled.actions)
        return FittedMDN(
            settings=self,
            state_width=labeled.states.shape[1],
            action_width=labeled.actions.shape[1],
            states=states,
            actions=actions,
            network=mixture.learn(
                states(labeled.states), actions(labeled.actions), self, seed=seed
            ),
        )


@dataclass(frozen=True, eq=False)
class Mixture:
    """Of n states: weights (n, K), means and variances (n, K, k) of the components."""

    weights: NDArray[np.float32]
    means: NDArray[np.float32]
    variances: NDArray[np.float32]

    def aleatoric(self) -> NDArray[np.float32]:
        """Σ_k π_k σ_k², summed over action dimensions (n,) (paper)."""
        return np.einsum("nk,nka->n", self.weights, self.variances)

    def epistemic(self) -> NDArray[np.float32]:
        """Σ_k π_k ‖μ_k − Σ_j π_j μ_j‖² (n,) (paper)."""
        centred = self.means - np.einsum("nk,nka->na", self.weights, self.means)[:, None]
        return np.einsum("nk,nka->n", self.weights, np.square(centred))

    def surprisal(self, actions: NDArray[np.float32]) -> NDArray[np.float32]:
        """−log Σ_k π_k N(a; μ_k, σ_k²) (n,), in nats."""
        distance = np.square(actions[:, None] - self.means) / self.variances
        log_density = -(distance + np.log(2 * np.pi * self.variances)).sum(axis=2) / 2
        with np.errstate(divide="ignore"):
            log_joint = np.log(self.weights) + log_density
        most = log_joint.max(axis=1, keepdims=True)
        return -(most[:, 0] + np.log(np.exp(log_joint - most).sum(axis=1)))


@dataclass(frozen=True, eq=False)
class FittedMDN(Fitted):
    """r = aleatoric + epistemic variance of the standardised action (paper)."""

    settings: MDN
    states: Standardizer
    actions: Standardizer
    network: Perceptron

    def __post_init__(self) -> None:
        """Validate that the parts fit the settings and the widths."""
        outputs = self.settings.components * (1 + 2 * self.action_width)
        expect("states", self.states.width, self.state_width)
        expect("actions", self.actions.width, self.action_width)
        expect("network", self.network.widths, (self.state_width, outputs))

    def mixture(self, states: NDArray[np.float32]) -> Mixture:
        """Return the mixture of standardised actions in raw `states` (n, d)."""
        count, width = self.settings.components, self.action_width
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
            parts = mixture.aleatoric(), mixture.epistemic()
            judged = self.settings.surprisal
            total = mixture.surprisal(self.actions(actions)) if judged else sum(parts)
            return np.column_stack([total, *parts])

        total, aleatoric, epistemic = apply_in_blocks(judge, pairs.states, pairs.actions).T.copy()
        return Uncertainty(total, {"aleatoric": aleatoric, "epistemic": epistemic})
