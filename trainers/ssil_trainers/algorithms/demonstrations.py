"""The demonstrations that a method learns from, as arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardizer
from ssil_data.field import LeverageField
from ssil_data.surface import FieldLike, ModelLike

_MISSING_RUN = "method: needs the leverage of a scoring run; name one"
_ARRAYS = {"states": np.float32, "actions": np.float32, "labeled": np.bool_, "leverage": np.float32}


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """The pairs to learn from, which of them are labeled, and the leverage of a scoring run.

    Parameters
    ----------
    states:
        States, (n, d), in raw units.
    actions:
        Actions, (n, k), in raw units.
    labeled:
        Which pairs are labeled as expert demonstrations, (n,); at least one.
    leverage:
        Leverage of each pair by a scoring run, (n,), 1 for expert-like; None without a run.
    field:
        The leverage field of that run; None without a run.
    open_model:
        Opens the fitted model of that run, for leverage of other pairs; None without a run.
    threads:
        Threads of a field that is made from these demonstrations; None for all processors.

    Raises
    ------
    InvalidInputError
        For unequal lengths, without a labeled pair, or for leverage that is not from 0 to 1.

    Examples
    --------
    >>> states = np.arange(4, dtype=np.float32)[:, None]
    >>> demonstrations = Demonstrations(states, -states, np.array([True, True, False, False]))
    >>> demonstrations.standardizer.shift
    array([1.5], dtype=float32)
    """

    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    labeled: NDArray[np.bool_]
    leverage: NDArray[np.float32] | None = None
    field: FieldLike | None = None
    open_model: Callable[[], ModelLike] | None = None
    threads: int | None = None

    def __post_init__(self) -> None:
        """Make arrays of lists; refuse unequal lengths, no labels, and leverage out of range."""
        for name, kind in _ARRAYS.items():
            _make_array(self, name, kind)
        lengths = (len(self.states), len(self.actions), len(self.labeled))
        if len(set(lengths)) > 1:
            raise InvalidInputError(
                f"demonstrations: states, actions and labels differ in length: {lengths}"
            )
        if not self.labeled.any():
            raise InvalidInputError("demonstrations: no pair is labeled; label at least one")
        if self.leverage is not None:
            _check_leverage(self.leverage, len(self.labeled))

    @property
    def standardizer(self) -> Standardizer:
        """The standardization of states by all demonstrations."""
        return Standardizer.of(self.states)

    @property
    def require_leverage(self) -> NDArray[np.float32]:
        """The leverage, (n,); raises InvalidInputError without a run."""
        if self.leverage is None:
            raise InvalidInputError(_MISSING_RUN)
        return self.leverage

    @property
    def require_field(self) -> FieldLike:
        """The leverage field; raises InvalidInputError without a run."""
        if self.field is None:
            raise InvalidInputError(_MISSING_RUN)
        return self.field

    def require_model(self) -> ModelLike:
        """Open the model of the run, which gives any pair a leverage.

        Raises
        ------
        InvalidInputError
            Without a run.
        """
        if self.open_model is None:
            raise InvalidInputError(_MISSING_RUN)
        return self.open_model()

    def make_field(self, leverage: NDArray[np.float32], alpha: float) -> LeverageField:
        """Make a leverage field over these states in this process.

        Parameters
        ----------
        leverage:
            Leverage of each pair, (n,).
        alpha:
            Sharpness of the kernel, above 0.
        """
        return LeverageField(
            self.states, leverage, self.labeled, self.standardizer, alpha, threads=self.threads
        )


def _make_array(of: Demonstrations, name: str, kind: type[np.generic]) -> None:
    """Replace a list of numbers by an array; an array, and what is left out, stays as it is."""
    value = getattr(of, name)
    if value is None or isinstance(value, np.ndarray):
        return
    try:
        object.__setattr__(of, name, np.asarray(value, kind))
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name}: expected an array of numbers: {error}") from None


def _check_leverage(leverage: NDArray[np.float32], pairs: int) -> None:
    """Raise InvalidInputError unless there is one number from 0 to 1 per pair; NaN is none."""
    if leverage.shape != (pairs,):
        raise InvalidInputError(
            f"leverage: expected one number per pair, {pairs}, found shape {leverage.shape}"
        )
    outside = np.flatnonzero(~((leverage >= 0) & (leverage <= 1)))
    if len(outside):
        raise InvalidInputError(
            f"leverage: expected numbers from 0 to 1, found {leverage[outside[0]]} at row "
            f"{outside[0]}"
        )
