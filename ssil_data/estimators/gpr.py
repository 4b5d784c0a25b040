"""GPR: a pair is strange where a Gaussian process of experts' actions is unsure.

The posterior of one action dimension at a state s, given n labeled pairs (X, y) and m inducing
states Z (Titsias, 2009; with Z = X it is the exact posterior):

    k = kernel(Z, s),  kernel(Z, Z) = U diag(λ) Uᵀ,  P = U diag(λ)^-½,  G = kernel(X, Z) P
    GᵀG / noise = V diag(γ) Vᵀ,  φ = (P V diag(γ / (1 + γ))^½)ᵀ k
    variance(s) = signal − ‖φ‖²,  mean(s) = φ · (diag(γ (1 + γ))^-½ Vᵀ Gᵀ y / noise)
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
    expect,
    in_blocks,
    labeled_enough,
)
from ssil_data.features import Standardiser

NEGLIGIBLE = 1e-3
"""Share of the signal variance that the posterior may lose: a bound, met by a thousandth."""

JITTER = 1e-8
"""Share of the signal variance added to inducing points, which may lie on top of each other."""

FAINTEST = -30.0
"""Least exponent of the kernel: nothing to float32, and products do not slow down as denormals."""


@dataclass(frozen=True)
class GPR(Estimator):
    """Gaussian process state → action: ARD RBF kernel plus noise, one per action dimension.

    The kernel is learned from `learn_on` pairs drawn by the seed; the posterior is exact up to
    `inducing` labeled pairs, beyond which that many of them, drawn too, are inducing points.
    `noise_floor` is the least noise variance, as a share of the action's variance.
    `surprisal`: −log p(a | s) instead of the deviation; it may be negative.
    """

    kind: ClassVar[str] = "gpr"
    learn_on: int = 600
    inducing: int = 2048
    steps: int = 20
    noise_floor: float = 1e-3
    surprisal: bool = False

    def fit(self, labeled: Pairs, *, seed: int) -> FittedGPR:
        """Fit to the labeled pairs, standardised by their own mean and deviation."""
        from ssil_data.estimators.learning import marginal

        labeled_enough(labeled)
        states, actions = Standardiser.of(labeled.states), Standardiser.of(labeled.actions)
        x, y = states(labeled.states), actions(labeled.actions)
        order = np.random.default_rng(seed).permutation(len(x))
        some, inducing = np.sort(order[: self.learn_on]), np.sort(order[: self.inducing])
        kernel = marginal.learn(x[some], y[some], self)
        root, coefficients = condition(kernel, x[inducing], x, y)
        return FittedGPR(
            settings=self,
            state_width=x.shape[1],
            action_width=y.shape[1],
            states=states,
            actions=actions,
            kernel=kernel,
            inducing=x[inducing],
            root=root,
            coefficients=coefficients,
        )


@dataclass(frozen=True, eq=False)
class Kernel:
    """Of k action dimensions: lengthscale (k, d), signal and noise variance (k,), all float32."""

    lengthscale: NDArray[np.float32]
    signal: NDArray[np.float32]
    noise: NDArray[np.float32]

    def __call__(self, action: int, a: NDArray, b: NDArray) -> NDArray:
        """Return signal · exp(−½‖(a_i − b_j) / lengthscale‖²) (n, m) of one action dimension.

        The exponent is one matrix product of augmented rows: [a, −½‖a‖², 1]·[b, 1, −½‖b‖²]ᵀ.
        """
        a, b = a / self.lengthscale[action], b / self.lengthscale[action]
        one_a, one_b = np.ones((len(a), 1), a.dtype), np.ones((len(b), 1), b.dtype)
        half_a, half_b = (-np.square(rows).sum(axis=1, keepdims=True) / 2 for rows in (a, b))
        exponent = np.hstack([a, half_a, one_a]) @ np.hstack([b, one_b, half_b]).T
        np.exp(np.clip(exponent, FAINTEST, 0, out=exponent), out=exponent)
        return np.multiply(exponent, self.signal[action], out=exponent)


@dataclass(frozen=True, eq=False)
class FittedGPR(Fitted):
    """r = (Σ posterior variance of the k action dimensions)^½, without the constant noise."""

    settings: GPR
    states: Standardiser
    actions: Standardiser
    kernel: Kernel
    inducing: NDArray[np.float32]
    root: NDArray[np.float32]
    coefficients: NDArray[np.float32]

    def __post_init__(self) -> None:
        """Validate that the parts fit the widths."""
        count, action = len(self.inducing), self.action_width
        expect("states", self.states.width, self.state_width)
        expect("actions", self.actions.width, action)
        expect("lengthscale", self.kernel.lengthscale.shape, (action, self.state_width))
        expect("signal", self.kernel.signal.shape, (action,))
        expect("noise", self.kernel.noise.shape, (action,))
        expect("inducing", self.inducing.shape, (count, self.state_width))
        expect("root", self.root.shape[:2], (action, count))
        expect("coefficients", self.coefficients.shape, (action, self.root.shape[-1]))

    def posterior(self, states: NDArray[np.float32]) -> tuple[NDArray, NDArray]:
        """Return mean and variance (n, k) of the standardised noiseless action in raw states."""
        x = self.states(states)
        means, variances = [], []
        for action in range(self.action_width):
            known = self.kernel(action, x, self.inducing) @ self.root[action]
            means.append(known @ self.coefficients[action])
            variances.append(self.kernel.signal[action] - np.square(known).sum(axis=1))
        return np.column_stack(means), np.maximum(np.column_stack(variances), 0)

    def _uncertainty(self, pairs: Pairs) -> Uncertainty:
        def judge(states: NDArray[np.float32], actions: NDArray[np.float32]) -> NDArray[np.float32]:
            mean, variance = self.posterior(states)
            deviation = np.sqrt(variance.sum(axis=1))
            if not self.settings.surprisal:
                return np.column_stack([deviation, deviation])
            spread = variance + self.kernel.noise
            distance = np.square(self.actions(actions) - mean) / spread
            return np.column_stack(
                [(distance + np.log(2 * np.pi * spread)).sum(axis=1) / 2, deviation]
            )

        total, epistemic = in_blocks(judge, pairs.states, pairs.actions).T.copy()
        aleatoric = np.full_like(epistemic, np.sqrt(self.kernel.noise.sum()))
        return Uncertainty(total, {"aleatoric": aleatoric, "epistemic": epistemic})


def condition(
    kernel: Kernel, inducing: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the root (k, m, q) and the coefficients (k, q): φ = rootᵀ k, mean = φ · coefficients.

    Dimensions of φ that could explain less than `NEGLIGIBLE` of the signal together are left out,
    since φᵢ² ≤ signal · γᵢ / (1 + γᵢ); the rest is filled up with zeros to one width.
    """
    roots, coefficients = [], []
    some, every = inducing.astype(np.float64), x.astype(np.float64)
    for action, noise in enumerate(kernel.noise.astype(np.float64)):
        prior, vectors = np.linalg.eigh(kernel(action, some, some))
        p = vectors / np.sqrt(np.maximum(prior, 0) + JITTER * kernel.signal[action])
        g = kernel(action, every, some) @ p
        gain, v = np.linalg.eigh(g.T @ g / noise)
        kept = np.cumsum(gain / (1 + gain)) > NEGLIGIBLE
        gain, v = gain[kept], v[:, kept]
        roots.append(p @ (v * np.sqrt(gain / (1 + gain))))
        coefficients.append((v.T @ (g.T @ y[:, action])) / (noise * np.sqrt(gain * (1 + gain))))
    width = max(map(len, coefficients))
    filled = [np.pad(c, (0, width - len(c))) for c in coefficients]
    wide = [np.pad(root, ((0, 0), (0, width - root.shape[1]))) for root in roots]
    return np.array(wide, np.float32), np.array(filled, np.float32)
