"""A Gaussian process as plain arrays: torch conditions it, NumPy evaluates it.

The posterior of one action dimension at a state s is kept as features of s, φ = rootᵀ kernel(Z, s),
where Z are labeled states: variance(s) = signal − ‖φ‖², mean(s) = φ · coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SMALLEST_EXPONENT = -30.0
"""Least exponent of the kernel: nothing to float32, and products do not slow down as denormals."""


@dataclass(frozen=True, eq=False)
class Kernel:
    """ARD RBF kernel plus noise: how alike two states are, from `signal` (same) to 0 (far apart).

    Parameters
    ----------
    lengthscale
        Distance over which each state dimension matters, (d,) float32.
    signal
        Variance that the process explains, () float32.
    noise
        Variance that it does not explain, () float32.
    """

    lengthscale: NDArray[np.float32]
    signal: NDArray[np.float32]
    noise: NDArray[np.float32]

    def __call__(self, a: NDArray, b: NDArray) -> NDArray:
        """Return the covariance of every row of `a` with every row of `b`, without the noise.

        signal · exp(−½‖(a_i − b_j) / lengthscale‖²). The exponent is one matrix product of
        augmented rows: [a, −½‖a‖², 1]·[b, 1, −½‖b‖²]ᵀ.

        Parameters
        ----------
        a
            Standardized states (n, d).
        b
            Standardized states (m, d).

        Returns
        -------
        ndarray
            The covariances (n, m).
        """
        a = a / self.lengthscale
        b = b / self.lengthscale
        one_a = np.ones((len(a), 1), a.dtype)
        one_b = np.ones((len(b), 1), b.dtype)
        half_a = -np.square(a).sum(axis=1, keepdims=True) / 2
        half_b = -np.square(b).sum(axis=1, keepdims=True) / 2
        exponent = np.hstack([a, half_a, one_a]) @ np.hstack([b, one_b, half_b]).T
        np.exp(np.clip(exponent, SMALLEST_EXPONENT, 0, out=exponent), out=exponent)
        return np.multiply(exponent, self.signal, out=exponent)


@dataclass(frozen=True, eq=False)
class Process:
    """Posterior of one action dimension as features of a state, φ = rootᵀ kernel(Z, s).

    Parameters
    ----------
    kernel
        The prior covariance.
    root
        From covariances with the m inducing states to q features, (m, q) float32.
    coefficients
        From features to the mean, (q,) float32.
    """

    kernel: Kernel
    root: NDArray[np.float32]
    coefficients: NDArray[np.float32]

    def __call__(
        self, x: NDArray[np.float32], inducing: NDArray[np.float32]
    ) -> tuple[NDArray, NDArray]:
        """Return the posterior mean and variance of the action without its noise.

        Parameters
        ----------
        x
            Standardized states (n, d).
        inducing
            The standardized labeled states Z that the process was conditioned on, (m, d).

        Returns
        -------
        tuple of ndarray
            Mean (n,) and variance (n,) of the standardized action dimension.
        """
        features = self.kernel(x, inducing) @ self.root
        variance = self.kernel.signal - np.square(features).sum(axis=1)
        return features @ self.coefficients, np.maximum(variance, 0)
