"""What an estimator is given: standardized values and two-step windows; no estimator here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError

FARTHEST = 1e6
"""Deviations at which standardized values are clipped, so that squares stay finite in float32."""


@dataclass(frozen=True, eq=False)
class Standardizer:
    """Makes dimensions of any units comparable: subtracts a shift and divides by a scale.

    Parameters
    ----------
    shift
        Of each dimension, (d,) float32, usually the mean.
    scale
        Of each dimension, (d,) float32, positive, usually the deviation.

    Raises
    ------
    InvalidInputError
        For values that are not finite, scales that are not positive, or lengths that differ.
    """

    shift: NDArray[np.float32]
    scale: NDArray[np.float32]

    def __post_init__(self) -> None:
        """Validate shapes and signs; the arrays become read-only copies."""
        for name in ("shift", "scale"):
            vector = np.array(getattr(self, name), dtype=np.float32)
            vector.flags.writeable = False
            object.__setattr__(self, name, vector)
            if vector.ndim != 1 or not np.isfinite(vector).all():
                raise InvalidInputError(f"{name}: not one finite number per dimension: {vector}")
        if self.shift.shape != self.scale.shape:
            raise InvalidInputError(
                f"scale: expected {len(self.shift)} dimensions as in shift, found {len(self.scale)}"
            )
        if (self.scale <= 0).any():
            raise InvalidInputError(f"scale: expected positive numbers, found {self.scale.min()}")

    @classmethod
    def of(
        cls, values: NDArray[np.floating], *, least: NDArray[np.floating] | None = None
    ) -> Standardizer:
        """Return the one that gives some values mean 0 and deviation 1.

        Parameters
        ----------
        values
            (n, d), one row at least.
        least
            Least scale of each dimension, (d,): one that hardly varies in the values must not
            dominate. None for none.

        Raises
        ------
        InvalidInputError
            For no row.
        """
        if values.ndim != 2 or not len(values):
            raise InvalidInputError(f"values: expected at least one row, found {values.shape}")
        exact = np.asarray(values, dtype=np.float64)
        plain = cls.of_moments(exact.mean(axis=0), exact.var(axis=0))
        if least is None:
            return plain
        return cls(plain.shift, _raise_to(plain.scale, least, exact.std(axis=0)))

    @classmethod
    def of_moments(cls, mean: NDArray[np.float64], variance: NDArray[np.float64]) -> Standardizer:
        """Return the one of values whose mean and variance are known.

        A constant dimension gets scale 1. Constant means a deviation that float32 rounding alone
        could cause: a column of 1000.0 with a stray last bit must not be blown up to deviations.

        Parameters
        ----------
        mean
            (d,).
        variance
            (d,), not negative.
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
        """The number of dimensions."""
        return len(self.shift)

    def __call__(self, values: NDArray[np.floating]) -> NDArray[np.float32]:
        """Standardize values.

        Parameters
        ----------
        values
            (n, d).

        Returns
        -------
        ndarray
            (n, d) float32 in deviations, clipped to ±`FARTHEST`.

        Raises
        ------
        InvalidInputError
            For another width.
        """
        if values.ndim != 2 or values.shape[1] != len(self.shift):
            raise InvalidInputError(
                f"values: expected width {len(self.shift)}, found shape {values.shape}"
            )
        with np.errstate(over="ignore"):
            standard = (np.asarray(values, dtype=np.float32) - self.shift) / self.scale
        return np.clip(standard, -FARTHEST, FARTHEST, out=standard)


def _raise_to(
    scale: NDArray[np.float32], least: NDArray[np.floating], deviation: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Raise scales to the least ones; a constant dimension takes its least scale, if it has one."""
    known = least > np.finfo(np.float32).tiny
    raised = np.maximum(deviation, least)
    return np.where(known, raised, scale).astype(np.float32)


def windows(states: NDArray[np.float32], episode: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return windows of two steps, which show how the state moves; never across episodes.

    Row t is [s_t, s_{t+1}]. The last step of an episode takes the window that ends in it,
    [s_{T-2}, s_{T-1}]; an episode of one step takes [s, s].

    Parameters
    ----------
    states
        (n, d), rows of one episode adjacent.
    episode
        Number of each row's episode, (n,).

    Returns
    -------
    ndarray
        (n, 2d).

    Raises
    ------
    InvalidInputError
        For lengths that differ.
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
