"""GPR: a pair is strange where a Gaussian process of experts' actions is unsure.

The posterior of one action dimension at a state s is kept as features of s, φ = rootᵀ kernel(Z, s),
where Z are labeled states: variance(s) = signal − ‖φ‖², mean(s) = φ · coefficients.
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
from ssil_data.features import Standardizer

FAINTEST = -30.0
"""Least exponent of the kernel: nothing to float32, and products do not slow down as denormals."""


@dataclass(frozen=True)
class GPR(Estimator):
    """Gaussian process state → action: ARD RBF kernel plus noise, one per action dimension.

    The kernel is learned from `learn_on` pairs drawn by the seed; the posterior is exact up to
    `inducing` labeled pairs, beyond which that many of them, drawn too, are inducing points.
    `steps` of L-BFGS are few on purpose: the lengthscales overfit soon. `noise_floor` is the least
    noise variance, as a share of the action's variance. `surprisal`: −log p(a | s) of the
    standardised action, in nats, instead of the deviation (an extension of the paper); it may be
    negative.
    """

    kind: ClassVar[str] = "gpr"
    learn_on: int = 600
    inducing: int = 2048
    steps: int = 10
    noise_floor: float = 1e-3
    surprisal: bool = False

    def fit(self, labeled: Pairs, *, seed: int) -> FittedGPR:
        """Fit to the labeled pairs, standardised by their own mean and deviation."""
        from ssil_data.estimators.learning import marginal, posterior

        refuse_unfit(labeled, seed)
        states, actions = Standardizer.of(labeled.states), Standardizer.of(labeled.actions)
        x, y = states(labeled.states), actions(labeled.actions)
        order = np.random.default_rng(seed).permutation(len(x))
        some, inducing = np.sort(order[: self.learn_on]), np.sort(order[: self.inducing])
        kernels = marginal.learn(x[some], y[some], self)
        targets = zip(kernels, y.T, strict=True)
        return FittedGPR(
            settings=self,
            state_width=x.shape[1],
            action_width=y.shape[1],
            states=states,
            actions=actions,
            inducing=x[inducing],
            processes=tuple(posterior.condition(k, x[inducing], x, each) for k, each in targets),
        )


@dataclass(frozen=True, eq=False)
class Kernel:
    """ARD RBF kernel plus noise: lengthscale (d,), signal and noise variance (), all float32."""

    lengthscale: NDArray[np.float32]
    signal: NDArray[np.float32]
    noise: NDArray[np.float32]

    def __call__(self, a: NDArray, b: NDArray) -> NDArray:
        """Return signal · exp(−½‖(a_i − b_j) / lengthscale‖²) (n, m) of rows a (n, d), b (m, d).

        The exponent is one matrix product of augmented rows: [a, −½‖a‖², 1]·[b, 1, −½‖b‖²]ᵀ.
        """
        a, b = a / self.lengthscale, b / self.lengthscale
        one_a, one_b = np.ones((len(a), 1), a.dtype), np.ones((len(b), 1), b.dtype)
        half_a, half_b = (-np.square(rows).sum(axis=1, keepdims=True) / 2 for rows in (a, b))
        exponent = np.hstack([a, half_a, one_a]) @ np.hstack([b, one_b, half_b]).T
        np.exp(np.clip(exponent, FAINTEST, 0, out=exponent), out=exponent)
        return np.multiply(exponent, self.signal, out=exponent)


@dataclass(frozen=True, eq=False)
class Process:
    """Posterior of one action dimension: φ = rootᵀ k, with root (m, q) and coefficients (q,)."""

    kernel: Kernel
    root: NDArray[np.float32]
    coefficients: NDArray[np.float32]

    def __call__(
        self, x: NDArray[np.float32], inducing: NDArray[np.float32]
    ) -> tuple[NDArray, NDArray]:
        """Return mean and variance (n,) at standardised states x (n, d)."""
        known = self.kernel(x, inducing) @ self.root
        variance = self.kernel.signal - np.square(known).sum(axis=1)
        return known @ self.coefficients, np.maximum(variance, 0)


@dataclass(frozen=True, eq=False)
class FittedGPR(Fitted):
    """r = (Σ posterior variance of the action dimensions)^½, without the constant noise."""

    settings: GPR
    states: Standardizer
    actions: Standardizer
    inducing: NDArray[np.float32]
    processes: tuple[Process, ...]

    def __post_init__(self) -> None:
        """Validate that the parts fit the widths."""
        count, width = self.inducing.shape
        expect("states", self.states.width, self.state_width)
        expect("actions", self.actions.width, self.action_width)
        expect("inducing", width, self.state_width)
        expect("processes", len(self.processes), self.action_width)
        for process in self.processes:
            expect("lengthscale", process.kernel.lengthscale.shape, (width,))
            expect("signal", process.kernel.signal.shape, ())
            expect("noise", process.kernel.noise.shape, ())
            expect("root", process.root.shape, (count, len(process.coefficients)))
            expect("coefficients", process.coefficients.ndim, 1)

    @property
    def noise(self) -> NDArray[np.float32]:
        """Noise variance of each standardised action dimension (k,)."""
        return np.array([process.kernel.noise for process in self.processes])

    def posterior(self, states: NDArray[np.float32]) -> tuple[NDArray, NDArray]:
        """Return mean and variance (n, k) of the standardised noiseless action in raw states."""
        x = self.states(states)
        moments = [process(x, self.inducing) for process in self.processes]
        mean, variance = (np.column_stack(each) for each in zip(*moments, strict=True))
        return mean, variance

    def _uncertainty(self, pairs: Pairs) -> Uncertainty:
        def judge(states: NDArray[np.float32], actions: NDArray[np.float32]) -> NDArray[np.float32]:
            mean, variance = self.posterior(states)
            deviation = np.sqrt(variance.sum(axis=1))
            if not self.settings.surprisal:
                return np.column_stack([deviation, deviation])
            spread = variance + self.noise
            distance = np.square(self.actions(actions) - mean) / spread
            surprisal = (distance + np.log(2 * np.pi * spread)).sum(axis=1) / 2
            return np.column_stack([surprisal, deviation])

        total, epistemic = apply_in_blocks(judge, pairs.states, pairs.actions).T.copy()
        aleatoric = np.full_like(epistemic, np.sqrt(self.noise.sum()))
        return Uncertainty(total, {"aleatoric": aleatoric, "epistemic": epistemic})
