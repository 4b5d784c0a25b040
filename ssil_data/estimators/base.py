"""What an estimator is: settings that fit, and the fitted thing that says how strange pairs are."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.errors import InvalidInputError

BLOCK = 512
"""Rows in flight at once: their intermediate results stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """How strange n pairs are: `total` (n,) float32, larger = stranger, and its named parts (n,).

    Parts are named among aleatoric and epistemic.
    """

    total: NDArray[np.float32]
    parts: Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True)
class Estimator(ABC):
    """Settings of an estimator; every number among them is positive."""

    kind: ClassVar[str]

    def __post_init__(self) -> None:
        """Validate every setting against the type of its default."""
        for field in fields(self):
            value = _check(f"{self.kind}: {field.name}", getattr(self, field.name), field.default)
            object.__setattr__(self, field.name, value)

    @abstractmethod
    def fit(self, labeled: Pairs, *, seed: int) -> Fitted:
        """Fit to labeled pairs, two at least; same seed, same machine, same result.

        Raises InvalidInputError.
        """


@dataclass(frozen=True, eq=False)
class Fitted(ABC):
    """A fitted estimator: plain arrays and formulas, made for states and actions of two widths."""

    settings: Estimator
    state_width: int
    action_width: int

    @property
    def margin(self) -> int:
        """Neighbouring rows of the same episode that a batch needs on either side."""
        return 0

    def uncertainty(self, pairs: Pairs) -> Uncertainty:
        """Return the uncertainty of each pair; raises InvalidInputError on another width."""
        self.refuse_other_widths(pairs)
        return self._uncertainty(pairs)

    @abstractmethod
    def _uncertainty(self, pairs: Pairs) -> Uncertainty: ...

    def shares(self, pairs: Pairs) -> NDArray[np.float32] | None:
        """Return each state dimension's share of the uncertainty (n, d), or None; rows sum to 1."""
        return None

    def refuse_other_widths(self, pairs: Pairs) -> None:
        """Raise InvalidInputError, naming both sides, if the pairs are not as wide as fitted."""
        expect("state width", pairs.states.shape[1], self.state_width)
        expect("action width", pairs.actions.shape[1], self.action_width)


def expect(name: str, found: object, expected: object) -> None:
    """Raise InvalidInputError naming both sides if they differ."""
    if found != expected:
        raise InvalidInputError(f"{name}: expected {expected}, found {found}")


def refuse_unfit(labeled: Pairs, seed: int) -> None:
    """Raise InvalidInputError if there is nothing to fit to, or the seed is none."""
    if len(labeled) < 2:
        raise InvalidInputError(f"labeled: expected at least 2 pairs, found {len(labeled)}")
    if not 0 <= seed < 2**63:
        raise InvalidInputError(f"seed: expected a number from 0 to 2^63 - 1, found {seed}")


def apply_in_blocks(formula: Callable[..., NDArray], *arrays: NDArray) -> NDArray:
    """Apply a row-wise formula to `BLOCK` rows at a time of arrays with n rows each."""
    starts = range(0, max(1, len(arrays[0])), BLOCK)
    return np.concatenate([formula(*(a[i : i + BLOCK] for a in arrays)) for i in starts])


def _check(name: str, value: Any, default: object) -> float:
    """Return `value` in the type of `default`: a truth value, a count or a positive number."""
    if isinstance(default, bool):
        if isinstance(value, bool):
            return value
        raise InvalidInputError(f"{name}: expected true or false, found {value!r}")
    whole = isinstance(default, int)
    number = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
    if not number or not 0 < value < math.inf:
        kind = "whole" if whole else "finite"
        raise InvalidInputError(f"{name}: expected a {kind} number > 0, found {value!r}")
    return value if whole else float(value)
