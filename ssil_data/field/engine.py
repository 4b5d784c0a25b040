"""What the values of a leverage field are computed from: demonstrations packed for the kernels.

An engine does not depend on α, so that fields that differ in α only share one: packed states, which
take as much memory as the states themselves, the order for sampling, and the moments of CoR. Each
is made when it is first needed, once, whatever number of threads need it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from threading import RLock
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.demonstrations import finite_matrix, finite_vector
from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardizer
from ssil_data.kernels import Moments, References, Sampled

_DEVIATION_QUERIES = 256
"""Demonstration states from whose LCoR its standard deviation is estimated."""
_MOMENT_ROWS = 1 << 18
"""Rows that are standardized at once for the moments of CoR."""


class FieldEngine:
    """Demonstrations with their leverage, packed for the kernels.

    Parameters
    ----------
    states:
        (n, d) in raw units; a read-only float32 array, such as a mapped file, is not copied.
    leverage:
        (n,) in [0, 1].
    labeled:
        (n,) true for the expert states of CoR.
    standardizer:
        Makes the units of the dimensions comparable.
    device:
        Where torch keeps the states for exact values, as "cuda"; "cpu" runs code that is written
        for the processor.

    Raises
    ------
    InvalidInputError
        For no states, values that are not finite, unequal lengths, leverages outside [0, 1].
    """

    def __init__(
        self,
        states: ArrayLike,
        leverage: ArrayLike,
        labeled: ArrayLike,
        *,
        standardizer: Standardizer,
        device: str,
    ) -> None:
        self.states = finite_matrix("states", states)
        self.leverage = finite_vector("leverage", leverage)
        self.labeled = np.asarray(labeled, bool)
        self.standardizer = standardizer
        self.device = device
        self._rows = _StandardizedRows(self.states, standardizer)
        # reentrant: making the sample makes the references
        self._lock = RLock()
        self._check_lengths()
        _check_leverage(self.leverage)

    def _check_lengths(self) -> None:
        for name, values in (("leverage", self.leverage), ("labeled", self.labeled)):
            if values.shape != self.states.shape[:1]:
                raise InvalidInputError(
                    f"{name}: expected one per state, "
                    f"found shape {values.shape} for {len(self.states)} states"
                )
        if not len(self.states):
            raise InvalidInputError("states: expected at least one, found none")

    def is_made_of(self, states: Any, leverage: Any, labeled: Any) -> bool:
        """Tell whether arrays are the engine's own, so that they need no validation.

        Parameters
        ----------
        states, leverage, labeled:
            As a field has them; compared by identity, not by value.
        """
        return states is self.states and leverage is self.leverage and labeled is self.labeled

    def references(self) -> References:
        """Return the demonstrations packed for exact sums."""
        with self._lock:
            return self._references

    def sampler(self) -> Sampled:
        """Return the demonstrations ordered for sampling."""
        with self._lock:
            return self._sampler

    def moments(self) -> tuple[Moments, Moments]:
        """Return the moments of the labeled states and of all others, which make CoR.

        Raises InvalidInputError if all states are labeled, or none.
        """
        with self._lock:
            return self._moments

    def deviation(self, alpha: float) -> float:
        """Return the standard deviation of LCoR over the demonstration states, from a sample.

        Parameters
        ----------
        alpha:
            The kernel's sharpness.
        """
        chosen = np.random.default_rng(0).integers(len(self.states), size=_DEVIATION_QUERIES)
        found = self.sampler().deviation(self._rows[chosen], alpha=alpha)
        return max(found, np.finfo(float).tiny)

    def standardize(self, states: ArrayLike) -> NDArray[np.float32]:
        """Return queries as the kernel takes them.

        Parameters
        ----------
        states:
            (m, d) in raw units.

        Raises
        ------
        InvalidInputError
            For another width, or values that are not finite.
        """
        return self.standardizer(finite_matrix("states", states, width=self.states.shape[1]))

    @cached_property
    def _references(self) -> References:
        return References(self._rows, self.leverage, device=self.device)

    @cached_property
    def _sampler(self) -> Sampled:
        return Sampled(self._rows, self.leverage, self.references)

    @cached_property
    def _moments(self) -> tuple[Moments, Moments]:
        count = int(self.labeled.sum())
        if not 0 < count < len(self.labeled):
            raise InvalidInputError(
                f"cor: expected labeled and unlabeled states, found {count} labeled of "
                f"{len(self.labeled)}"
            )
        return self._moments_of(self.labeled), self._moments_of(~self.labeled)

    def _moments_of(self, chosen: NDArray[np.bool_]) -> Moments:
        rows = np.flatnonzero(chosen)
        parts = np.array_split(rows, -(-len(rows) // _MOMENT_ROWS))
        return Moments.of_parts(self._rows[part] for part in parts)


@dataclass(frozen=True)
class _StandardizedRows:
    """States as the kernel takes them, standardized as they are read."""

    states: NDArray[np.float32]
    standardizer: Standardizer

    @property
    def shape(self) -> tuple[int, ...]:
        return self.states.shape

    def __getitem__(self, rows: slice | NDArray[np.int64], /) -> NDArray[np.float32]:
        return self.standardizer(self.states[rows])


def _check_leverage(leverage: NDArray[np.float32]) -> None:
    outside = np.flatnonzero((leverage < 0) | (leverage > 1))
    if len(outside):
        row = int(outside[0])
        raise InvalidInputError(
            f"leverage: expected numbers from 0 to 1, found {leverage[row]} at row {row}"
        )
