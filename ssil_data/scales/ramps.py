"""Straight scales: min–max, as in the paper, and between two quantiles of the pool."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.json_kinds import check_fields
from ssil_data.scales.base import FittedScale, Scale, check_finite, check_numbers


@dataclass(frozen=True)
class MinMax(Scale):
    """The paper's scale: 1 at the pool's least uncertainty, 0 at its largest.

    One outlier squeezes all other pairs together near 1.

    Source
    ------
    Algorithm 1 of the paper: l = (r_max − r) / (r_max − r_min).

    Examples
    --------
    >>> scale = sd.MinMax().fit([1.0, 2.0, 5.0])
    >>> scale([1.0, 2.0, 5.0]).tolist()
    [1.0, 0.75, 0.0]
    """

    kind: ClassVar[str] = "minmax"

    def fit(
        self,
        pool_uncertainty: ArrayLike,
        held_out_labeled_uncertainty: ArrayLike | None = None,
        *,
        stretch: int = 1,
    ) -> Ramp:
        """Return the ramp from the pool's least uncertainty to its largest.

        Parameters
        ----------
        pool_uncertainty
            Of all pairs, (n,).
        held_out_labeled_uncertainty, stretch
            Not used.
        """
        pool = check_finite("pool uncertainty", pool_uncertainty)
        return Ramp(low=float(pool.min()), high=float(pool.max()))


@dataclass(frozen=True)
class Quantile(Scale):
    """Min–max between two quantiles of the pool, clipped, so that outliers cost nothing.

    Parameters
    ----------
    low
        Share of the pool, by increasing uncertainty, that gets leverage 1.
    high
        Share of the pool beyond which leverage is 0.

    Raises
    ------
    InvalidInputError
        Unless 0 ≤ low < high ≤ 1.

    Examples
    --------
    >>> scale = sd.Quantile(low=0.0, high=0.5).fit([0.0, 1.0, 2.0, 3.0, 100.0])
    >>> scale([0.0, 1.0, 100.0]).tolist()
    [1.0, 0.5, 0.0]
    """

    kind: ClassVar[str] = "quantile"
    low: float = 0.05
    high: float = 0.95

    def __post_init__(self) -> None:
        """Validate 0 ≤ low < high ≤ 1."""
        check_fields(self.kind, self)
        if not 0 <= self.low < self.high <= 1:
            raise InvalidInputError(
                f"quantile: expected 0 <= low < high <= 1, found low {self.low}, high {self.high}"
            )

    def fit(
        self,
        pool_uncertainty: ArrayLike,
        held_out_labeled_uncertainty: ArrayLike | None = None,
        *,
        stretch: int = 1,
    ) -> Ramp:
        """Return the ramp from the pool's low quantile to its high one.

        Parameters
        ----------
        pool_uncertainty
            Of all pairs, (n,).
        held_out_labeled_uncertainty, stretch
            Not used.
        """
        pool = check_finite("pool uncertainty", pool_uncertainty)
        low, high = np.quantile(pool, [self.low, self.high])
        return Ramp(low=float(low), high=float(high))


@dataclass(frozen=True)
class Ramp(FittedScale):
    """Leverage (high − r) / (high − low), clipped; with low == high, 1 up to it and 0 beyond it.

    Parameters
    ----------
    low
        Uncertainty up to which leverage is 1.
    high
        Uncertainty from which on leverage is 0.

    Raises
    ------
    InvalidInputError
        Unless both are finite and low ≤ high.
    """

    kind: ClassVar[str] = "ramp"
    low: float
    high: float

    def __post_init__(self) -> None:
        """Validate finite ends in order."""
        check_fields(self.kind, self)
        if not (np.isfinite(self.high - self.low) and self.low <= self.high):
            raise InvalidInputError(
                f"ramp: expected finite low <= high, found low {self.low}, high {self.high}"
            )

    def __call__(self, uncertainty: ArrayLike) -> NDArray[np.float32]:
        """Return the leverage (n,) of uncertainty (n,).

        Parameters
        ----------
        uncertainty
            (n,), not NaN.
        """
        r = check_numbers(uncertainty)
        if self.low == self.high:
            return (r <= self.low).astype(np.float32)
        return np.clip((self.high - r) / (self.high - self.low), 0, 1).astype(np.float32)
