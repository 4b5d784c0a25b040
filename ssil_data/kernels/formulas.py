r"""The kernel of CoR and LCoR (Lee et al., equations 2 and 5), in the logarithm.

    k(d) = (1 + d/α)^(−(α+1)/2),   log k(d) = −(α+1)/2 · log(1 + d/α)

CoR of a state s against expert states E and negative states N is k(d_E) / (k(d_E) + k(d_N)) with
d_X the root of the mean squared distance to X. Because that mean is ‖s − mean(X)‖² + tr Cov(X), a
query costs O(d) whatever the size of X. LCoR is the mean of the leverages l_j, weighted by
k(‖s − s_j‖₁) over all demonstration states s_j.

The paper allows α > −1; for α ≤ 0 the base is undefined or negative, so α > 0 is required.
Only ratios of kernels are ever needed. Taking their differences in the logarithm first keeps them
exact where the kernel itself underflows: large α, far from the data.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError

MIN_ALPHA = 1e-6
MAX_ALPHA = 1e8
"""Between these two, log k(d) is finite and exact for every distance; beyond, k stays the same."""


def check_alpha(alpha: float) -> float:
    """Return α if it is within MIN_ALPHA and MAX_ALPHA.

    Parameters
    ----------
    alpha
        Sharpness of the kernel; the larger, the less do distant references count.

    Raises
    ------
    InvalidInputError
        If it is not finite, not positive, or out of that range.
    """
    if not (np.isfinite(alpha) and alpha > 0):
        raise InvalidInputError(f"alpha: expected a finite number > 0, found {alpha}")
    if not MIN_ALPHA <= alpha <= MAX_ALPHA:
        raise InvalidInputError(
            f"alpha: expected a number from {MIN_ALPHA:g} to {MAX_ALPHA:g}, found {alpha}"
        )
    return float(alpha)


def log_kernel(distance: ArrayLike, alpha: float) -> NDArray[np.float64]:
    """Return log k(d) ≤ 0: 0 at distance 0, the less the farther.

    Source: Lee et al., the kernel of equations 2 and 5.

    Parameters
    ----------
    distance
        Distances ≥ 0, of any shape.
    alpha
        Sharpness of the kernel, > 0.

    Returns
    -------
    NDArray
        Of the shape of `distance`.
    """
    distances = np.asarray(distance, np.float64)
    return -(alpha + 1) / 2 * np.log1p(distances / alpha)


@dataclass(frozen=True, eq=False)
class Moments:
    """All that CoR needs of a set of states: their mean (d,) and the trace of their covariance."""

    mean: NDArray[np.float64]
    trace: float

    @classmethod
    def of(cls, states: ArrayLike) -> Moments:
        """Summarize states.

        Parameters
        ----------
        states
            States (n, d), n ≥ 1.
        """
        values = np.asarray(states, np.float64)
        return cls(values.mean(axis=0), float(values.var(axis=0).sum()))

    @classmethod
    def of_parts(cls, parts: Iterable[ArrayLike]) -> Moments:
        """Summarize states that come in parts.

        Parameters
        ----------
        parts
            States (·, d), at least one part, each of at least one row.
        """
        counted = [(len(values := np.asarray(part)), cls.of(values)) for part in parts]
        weights = np.array([count for count, _ in counted], np.float64)
        weights /= weights.sum()
        means = np.stack([one.mean for _, one in counted])
        mean = weights @ means
        traces = np.array([one.trace for _, one in counted])
        return cls(mean, float(weights @ (traces + np.square(means - mean).sum(axis=1))))

    def rms_distance(self, states: ArrayLike) -> NDArray[np.float64]:
        """Return the root of the mean squared Euclidean distance to the states summarized.

        Parameters
        ----------
        states
            Queries (m, d).

        Returns
        -------
        NDArray
            Distances (m,).
        """
        offset = np.asarray(states, np.float64) - self.mean
        return np.sqrt(np.einsum("md,md->m", offset, offset) + self.trace)


def cor(states: ArrayLike, expert: Moments, negative: Moments, alpha: float) -> NDArray[np.float64]:
    """Return CoR of states: 1 = like the expert's states, 0 = like the negative ones.

    Exchanging expert and negative gives the complement to 1. Source: Lee et al., equation 2.

    Parameters
    ----------
    states
        Queries (m, d).
    expert, negative
        Summaries of the two sets of states.
    alpha
        Sharpness of the kernel, > 0.

    Returns
    -------
    NDArray
        CoR (m,) in [0, 1].
    """
    to_expert = log_kernel(expert.rms_distance(states), alpha)
    to_negative = log_kernel(negative.rms_distance(states), alpha)
    return 0.5 * (1 + np.tanh((to_expert - to_negative) / 2))
