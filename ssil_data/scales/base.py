"""The two halves of every scale, and what their input must be."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.json_kinds import show_short


class Scale(ABC):
    """Settings of a scale; `fit` gives the scale, which maps uncertainty to leverage."""

    kind: ClassVar[str]
    of_unlabeled: ClassVar[bool] = False
    """Whether the pool that it is fitted to is of the unlabeled pairs alone."""

    @abstractmethod
    def fit(
        self,
        pool_uncertainty: ArrayLike,
        held_out_labeled_uncertainty: ArrayLike | None = None,
        *,
        stretch: int = 1,
    ) -> FittedScale:
        """Fit to the uncertainty of the pairs that are to be scored.

        Parameters
        ----------
        pool_uncertainty
            Of all pairs, (n,).
        held_out_labeled_uncertainty
            Of labeled pairs that the estimator was not fitted on, (m,); for `Conformal` and
            `Posterior`.
        stretch
            About how many neighboring pairs one value rests on: so many count as one.

        Returns
        -------
        FittedScale
            The scale.

        Raises
        ------
        InvalidInputError
            Where a needed array is missing, empty, or not finite.
        """


class FittedScale(ABC):
    """A fitted scale: stored with a run and used unchanged for pairs that arrive later."""

    kind: ClassVar[str]

    @abstractmethod
    def __call__(self, uncertainty: ArrayLike) -> NDArray[np.float32]:
        """Return leverage; 1 = expert-like, and a larger uncertainty never gets a larger leverage.

        Parameters
        ----------
        uncertainty
            (n,), not NaN.

        Returns
        -------
        ndarray
            (n,) float32 in [0, 1].

        Raises
        ------
        InvalidInputError
            For NaN or another shape.
        """


def check_numbers(values: ArrayLike) -> NDArray[np.float64]:
    """Return a vector without NaN; infinity is allowed."""
    numbers = read_numbers("uncertainty", values)
    if numbers.ndim != 1 or np.isnan(numbers).any():
        raise InvalidInputError(
            f"uncertainty: expected one number per pair, none NaN, found shape {numbers.shape}"
        )
    return numbers


def check_finite(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return a vector of one finite number or more."""
    numbers = read_numbers(name, values)
    if numbers.ndim != 1 or not numbers.size or not np.isfinite(numbers).all():
        raise InvalidInputError(
            f"{name}: expected one finite number or more, found shape {numbers.shape} "
            f"with {np.count_nonzero(~np.isfinite(numbers))} not finite"
        )
    return numbers


def read_numbers(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return numbers as float64, of any shape, finite or not.

    Parameters
    ----------
    name
        What a message calls them.
    values
        What numpy takes for numbers; anything else is refused.
    """
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InvalidInputError(f"{name}: expected numbers, found {show_short(values)}") from None
