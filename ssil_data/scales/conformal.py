"""The conformal scale: leverage is a p-value among labeled pairs that were held out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.json_kinds import check_fields
from ssil_data.scales.base import FittedScale, Scale, check_finite, check_numbers


@dataclass(frozen=True)
class Conformal(Scale):
    """Conformal p-value: the share of held-out labeled pairs that are at least as uncertain.

    Comparable between estimators and datasets; fresh expert pairs get about uniform leverage.

    Parameters
    ----------
    held_out
        Share of labeled pairs that the estimator is not fitted on, between 0 and 1.

    Raises
    ------
    InvalidInputError
        Unless 0 < held_out < 1.

    Source
    ------
    Vovk, Gammerman and Shafer, Algorithmic Learning in a Random World, 2005.

    Examples
    --------
    >>> scale = sd.Conformal().fit([], held_out_labeled_uncertainty=[1.0, 2.0, 3.0, 4.0])
    >>> scale([0.5, 2.5, 9.0]).tolist()
    [1.0, 0.5, 0.0]
    """

    kind: ClassVar[str] = "conformal"
    held_out: float = 0.2

    def __post_init__(self) -> None:
        """Validate 0 < held_out < 1."""
        check_fields(self.kind, self)
        if not 0 < self.held_out < 1:
            raise InvalidInputError(f"held_out: expected 0 < share < 1, found {self.held_out}")

    def fit(
        self,
        pool_uncertainty: ArrayLike,
        held_out_labeled_uncertainty: ArrayLike | None = None,
        *,
        stretch: int = 1,
    ) -> Rank:
        """Return the scale of ranks among the held-out labeled pairs.

        Parameters
        ----------
        pool_uncertainty
            Not used.
        held_out_labeled_uncertainty
            Of labeled pairs that the estimator was not fitted on, (m,).
        stretch
            Not used.

        Raises
        ------
        InvalidInputError
            Without held-out pairs.
        """
        if held_out_labeled_uncertainty is None:
            raise InvalidInputError("conformal: needs the uncertainty of held-out labeled pairs")
        residuals = check_finite("held-out labeled uncertainty", held_out_labeled_uncertainty)
        return Rank(tuple(np.sort(residuals).tolist()))


@dataclass(frozen=True)
class Rank(FittedScale):
    """Leverage is the share of held-out labeled pairs that are at least as uncertain.

    Parameters
    ----------
    residuals
        Their uncertainty, at least one finite number; kept sorted.

    Raises
    ------
    InvalidInputError
        For none, or one that is not finite.
    """

    kind: ClassVar[str] = "rank"
    residuals: tuple[float, ...]

    def __post_init__(self) -> None:
        """Validate and keep the residuals as a sorted tuple of floats."""
        check_fields(self.kind, self)
        residuals = check_finite("residuals", self.residuals)
        object.__setattr__(self, "residuals", tuple(np.sort(residuals).tolist()))

    def __call__(self, uncertainty: ArrayLike) -> NDArray[np.float32]:
        """Return the leverage (n,) of uncertainty (n,).

        Parameters
        ----------
        uncertainty
            (n,), not NaN.
        """
        smaller = np.searchsorted(self.residuals, check_numbers(uncertainty), side="left")
        return (1 - smaller / len(self.residuals)).astype(np.float32)
