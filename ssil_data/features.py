"""What an estimator sees: standardised values and two-step windows; it knows no estimator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError

FARTHEST = 1e6
"""Deviations beyond which values are no longer told apart: squares stay finite in float32."""


@dataclass(frozen=True, eq=False)
class Standardizer:
    """Subtracts a shift and divides by a scale, per dimension: shift (d,), scale (d,) float32."""

    shift: NDArray[np.float32]
    scale: NDArray[np.float32]

    def __post_init__(self) -> None:
        """Validate shapes and signs; the arrays become read-only copies."""
        for name in ("shift", "scale"):
            vector = np.array(getattr(self, name), dtype=np.float32)
            vector.flags.writeable = False
            object.__setattr__(self, name, vector)
            if vector.ndim != 1 or not np.isfinite(vector).all():
                raise InvalidInputError(f"{name}: expected one finite number per dimension")
        if self.shift.shape != self.scale.shape:
            raise InvalidInputError(
                f"scale: expected {len(self.shift)} dimensions as in shift, found {len(self.scale)}"
            )
        if (self.scale <= 0).any():
            raise InvalidInputError(f"scale: expected positive numbers, found {self.scale.min()}")

    @classmethod
    def of(cls, values: NDArray[np.floating]) -> Standardizer:
        """Take the mean and deviation of `values` (n, d), one row at least."""
        if values.ndim != 2 or not len(values):
            raise InvalidInputError(f"values: expected at least one row, found {values.shape}")
        exact = np.asarray(values, dtype=np.float64)
        return cls.of_moments(exact.mean(axis=0), exact.var(axis=0))

    @classmethod
    def of_moments(cls, mean: NDArray[np.float64], variance: NDArray[np.float64]) -> Standardizer:
        """Take mean (d,) and variance (d,); a constant dimension gets scale 1.

        Constant means a deviation that float32 rounding alone could cause: a column 1000.0 with a
        stray last bit must not be blown up to deviations.
        """
        limits = np.finfo(np.float32)
        deviation = np.sqrt(variance)
        constant = deviation <= np.maximum(limits.eps * np.abs(mean), limits.tiny)
        return cls(
            shift=mean.astype(np.float32),
            scale=np.where(constant, 1, deviation).astype(np.float32),
        )

    @property
    def width(self) -> int:
        """Return the number of dimensions."""
        return len(self.shift)

    def __call__(self, values: NDArray[np.floating]) -> NDArray[np.float32]:
        """Standardise `values` (n, d) to float32, clipped to ±`FARTHEST`."""
        if values.ndim != 2 or values.shape[1] != len(self.shift):
            raise InvalidInputError(
                f"values: expected width {len(self.shift)}, found shape {values.shape}"
            )
        with np.errstate(over="ignore"):
            standard = (np.asarray(values, dtype=np.float32) - self.shift) / self.scale
        return np.clip(standard, -FARTHEST, FARTHEST, out=standard)


def windows(states: NDArray[np.float32], episode: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return the two-step windows (n, 2d): row t is [s_t, s_{t+1}], never across episodes.

    The last step of an episode takes the window that ends in it, [s_{T-2}, s_{T-1}]; an episode of
    one step takes [s, s]. Rows of one episode are adjacent, `episode` (n,) says where they change.
    """
    if len(states) != len(episode):
        raise InvalidInputError(
            f"episode: expected one number per state, found {len(episode)} != {len(states)}"
        )
    row = np.arange(len(states))
    goes_on = np.zeros(len(states), dtype=bool)
    goes_on[:-1] = episode[1:] == episode[:-1]
    comes_from = np.zeros(len(states), dtype=bool)
    comes_from[1:] = goes_on[:-1]
    first = np.where(~goes_on & comes_from, row - 1, row)
    second = np.where(goes_on, row + 1, row)
    return np.concatenate([states[first], states[second]], axis=1)
