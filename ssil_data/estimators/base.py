"""The two halves of every estimator: settings that fit, and a fitted value that scores pairs.

Uncertainty is larger for pairs less like the labeled ones; scales turn it into leverage.
"""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.errors import InvalidInputError
from ssil_data.estimators.unlabeled import UnlabeledSample
from ssil_data.json_kinds import show_short, to_python_number

BLOCK = 512
"""Rows computed at once, so that their intermediate results stay in the processor's cache."""

MOST_WHOLE = 10**9
"""Largest whole number among settings."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """How unlike the labeled pairs n pairs are; larger = less like them.

    Parameters
    ----------
    total
        The uncertainty of each pair, (n,) float32.
    parts
        What it is made of, by name (`aleatoric`: the expert varies here; `epistemic`: the estimator
        does not know), (n,) float32 each. Empty for an autoencoder.
    """

    total: NDArray[np.float32]
    parts: Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True)
class Estimator(ABC):
    """Settings of an estimator; every number among them is positive."""

    kind: ClassVar[str]
    added: ClassVar[frozenset[str]] = frozenset()
    """Settings that the first version did not have. They are stored only where they differ from
    their defaults, so that what it would have made keeps its bytes."""

    def __post_init__(self) -> None:
        """Validate every setting against the type of its default."""
        for field in fields(self):
            name = f"{self.kind}: {field.name}"
            value = _check_setting(name, getattr(self, field.name), field.default)
            object.__setattr__(self, field.name, value)

    @property
    def needs_unlabeled(self) -> bool:
        """Whether it is fitted on unlabeled pairs too."""
        return False

    @abstractmethod
    def fit(self, labeled: Pairs, *, seed: int, unlabeled: UnlabeledSample | None = None) -> Fitted:
        """Fit to labeled pairs; same seed, same machine, same result.

        Parameters
        ----------
        labeled
            Expert pairs, two at least.
        seed
            The only source of randomness, 0 to 2^63 − 1.
        unlabeled
            A sample of the unlabeled pairs. Most estimators take from it the least scale of a
            dimension alone; one that `needs_unlabeled` learns from it.

        Returns
        -------
        Fitted
            The fitted estimator; the settings stay as they are.

        Raises
        ------
        InvalidInputError
            For fewer than two pairs or another seed.
        """


@dataclass(frozen=True, eq=False)
class Fitted(ABC):
    """A fitted estimator: plain arrays and formulas.

    Parameters
    ----------
    settings
        What it was fitted with.
    state_width, action_width
        The widths d and k of the states and actions that it can judge.
    """

    settings: Estimator
    state_width: int
    action_width: int

    @property
    def margin(self) -> int:
        """Neighboring rows of the same episode that a batch needs on either side."""
        return 0

    def uncertainty(self, pairs: Pairs) -> Uncertainty:
        """Return the uncertainty of each pair; larger = less like the labeled pairs.

        Parameters
        ----------
        pairs
            n pairs of the fitted widths. Where `margin` is 1, neighboring rows of an episode must
            be in the same batch.

        Returns
        -------
        Uncertainty
            Totals and parts, (n,) each.

        Raises
        ------
        InvalidInputError
            For what is no pairs, or states or actions of another width.
        """
        self.check_widths(pairs)
        return self._uncertainty(pairs)

    @abstractmethod
    def _uncertainty(self, pairs: Pairs) -> Uncertainty: ...

    def shares(self, pairs: Pairs) -> NDArray[np.float32] | None:
        """Return each state dimension's share of the uncertainty; larger = more to blame.

        Parameters
        ----------
        pairs
            n pairs of the fitted widths.

        Returns
        -------
        ndarray or None
            The shares (n, d), rows sum to 1; None for an estimator that has none.

        Raises
        ------
        InvalidInputError
            For what is no pairs, or states or actions of another width.
        """
        return None

    def check_widths(self, pairs: Pairs) -> None:
        """Raise InvalidInputError for what is no pairs, or pairs that are not as wide as fitted.

        Parameters
        ----------
        pairs
            Those to be judged.
        """
        check_pairs("pairs", pairs)
        check_equal("state width", pairs.states.shape[1], self.state_width)
        check_equal("action width", pairs.actions.shape[1], self.action_width)


def check_equal(name: str, found: object, expected: object) -> None:
    """Raise InvalidInputError if two values differ.

    Parameters
    ----------
    name
        What the message calls them.
    found, expected
        The two sides.
    """
    if found != expected:
        raise InvalidInputError(f"{name}: expected {expected}, found {found}")


def check_pairs(name: str, value: object) -> None:
    """Raise InvalidInputError, saying how pairs are made, for anything but pairs.

    Parameters
    ----------
    name
        What the message calls the value.
    value
        What was given for pairs.
    """
    if not isinstance(value, Pairs):
        raise InvalidInputError(
            f"{name}: expected sd.Pairs, found {type(value).__name__}; make them by "
            "sd.Pairs(states, actions, episode, step), or take dataset.episode(number) or "
            "dataset.pairs()"
        )


def check_fit_input(labeled: Pairs, seed: int) -> None:
    """Raise InvalidInputError for fewer than two pairs or a seed that torch cannot take.

    Parameters
    ----------
    labeled
        The pairs to fit to.
    seed
        A number from 0 to 2^63 − 1.
    """
    check_pairs("labeled", labeled)
    if len(labeled) < 2:
        raise InvalidInputError(f"labeled: expected at least 2 pairs, found {len(labeled)}")
    whole = isinstance(seed, int | np.integer) and not isinstance(seed, bool)
    if not whole or not 0 <= seed < 2**63:
        raise InvalidInputError(
            f"seed: expected a whole number from 0 to 2^63 - 1, found {show_short(seed)}"
        )


def apply_in_blocks(formula: Callable[..., NDArray], *arrays: NDArray) -> NDArray:
    """Apply a formula to `BLOCK` rows at a time.

    Parameters
    ----------
    formula
        Computes every row of its result from the same row of its arguments.
    *arrays
        Its arguments, n rows each.

    Returns
    -------
    ndarray
        The results, n rows.
    """
    starts = range(0, max(1, len(arrays[0])), BLOCK)
    blocks = [formula(*(array[i : i + BLOCK] for array in arrays)) for i in starts]
    return np.concatenate(blocks)


def _check_setting(name: str, value: Any, default: object) -> float:
    """Return `value` in the type of `default`: a truth value, a count or a positive number."""
    if isinstance(default, bool):
        if isinstance(value, bool):
            return value
        raise InvalidInputError(f"{name}: expected true or false, found {show_short(value)}")
    value = to_python_number(value)
    whole = isinstance(default, int)
    number = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
    most = MOST_WHOLE if whole else sys.float_info.max
    if not number or not 0 < value <= most:
        kind = "whole" if whole else "finite"
        end = f", at most {most:,}" if whole and number and value > most else ""
        raise InvalidInputError(
            f"{name}: expected a {kind} number > 0{end}, found {show_short(value)}"
        )
    return value if whole else float(value)
