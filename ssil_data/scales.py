"""Scales: from uncertainty to leverage in [0, 1]; pure formulas, no estimator and no files.

The paper contradicts itself here. Its equation

    l_j = (r_j - r_min) / (r_max - r_min)

gives the *largest* error leverage 1; its Algorithm 1 and its prose give it to the smallest.
Algorithm 1 holds: leverage 1 is expert-like, l_j = (r_max - r_j) / (r_max - r_min), and a larger
uncertainty never gets a larger leverage.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError

_Kind = TypeVar("_Kind")


class Scale(ABC):
    """Settings of a scale; `fit` gives the scale, which maps uncertainty to leverage."""

    kind: ClassVar[str]

    @abstractmethod
    def fit(
        self,
        pool_uncertainty: ArrayLike,
        held_out_labeled_uncertainty: ArrayLike | None = None,
    ) -> FittedScale:
        """Fit to the uncertainty of the pairs that are to be scored.

        Parameters
        ----------
        pool_uncertainty
            Of all pairs, (n,).
        held_out_labeled_uncertainty
            Of labeled pairs that the estimator was not fitted on, (m,); for `Conformal` only.

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
    ) -> Ramp:
        """Return the ramp from the pool's least uncertainty to its largest.

        Parameters
        ----------
        pool_uncertainty
            Of all pairs, (n,).
        held_out_labeled_uncertainty
            Not used.
        """
        pool = _check_finite("pool uncertainty", pool_uncertainty)
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
        if not 0 <= self.low < self.high <= 1:
            raise InvalidInputError(
                f"quantile: expected 0 <= low < high <= 1, found low {self.low}, high {self.high}"
            )

    def fit(
        self,
        pool_uncertainty: ArrayLike,
        held_out_labeled_uncertainty: ArrayLike | None = None,
    ) -> Ramp:
        """Return the ramp from the pool's low quantile to its high one.

        Parameters
        ----------
        pool_uncertainty
            Of all pairs, (n,).
        held_out_labeled_uncertainty
            Not used.
        """
        pool = _check_finite("pool uncertainty", pool_uncertainty)
        low, high = np.quantile(pool, [self.low, self.high])
        return Ramp(low=float(low), high=float(high))


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
        if not 0 < self.held_out < 1:
            raise InvalidInputError(f"held_out: expected 0 < share < 1, found {self.held_out}")

    def fit(
        self,
        pool_uncertainty: ArrayLike,
        held_out_labeled_uncertainty: ArrayLike | None = None,
    ) -> Rank:
        """Return the scale of ranks among the held-out labeled pairs.

        Parameters
        ----------
        pool_uncertainty
            Not used.
        held_out_labeled_uncertainty
            Of labeled pairs that the estimator was not fitted on, (m,).

        Raises
        ------
        InvalidInputError
            Without held-out pairs.
        """
        if held_out_labeled_uncertainty is None:
            raise InvalidInputError("conformal: needs the uncertainty of held-out labeled pairs")
        residuals = _check_finite("held-out labeled uncertainty", held_out_labeled_uncertainty)
        return Rank(tuple(np.sort(residuals).tolist()))


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
        r = _check_numbers(uncertainty)
        if self.low == self.high:
            return (r <= self.low).astype(np.float32)
        return np.clip((self.high - r) / (self.high - self.low), 0, 1).astype(np.float32)


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
        residuals = _check_finite("residuals", self.residuals)
        object.__setattr__(self, "residuals", tuple(np.sort(residuals).tolist()))

    def __call__(self, uncertainty: ArrayLike) -> NDArray[np.float32]:
        """Return the leverage (n,) of uncertainty (n,).

        Parameters
        ----------
        uncertainty
            (n,), not NaN.
        """
        smaller = np.searchsorted(self.residuals, _check_numbers(uncertainty), side="left")
        return (1 - smaller / len(self.residuals)).astype(np.float32)


SCALES: dict[str, type[Scale]] = {scale.kind: scale for scale in (MinMax, Quantile, Conformal)}
"""Every scale by its kind."""

FITTED: dict[str, type[FittedScale]] = {scale.kind: scale for scale in (Ramp, Rank)}
"""Every fitted scale by its kind."""


def to_json(scale: Scale | FittedScale) -> dict[str, Any]:
    """Return settings or a fitted scale as a JSON object with its `kind`.

    Parameters
    ----------
    scale
        Either.
    """
    values = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in asdict(scale).items()  # pyright: ignore[reportArgumentType]
    }
    return {"kind": scale.kind, **values}


def from_json(json: Mapping[str, Any]) -> FittedScale:
    """Read a fitted scale from `to_json`'s object.

    Parameters
    ----------
    json
        The object.

    Raises
    ------
    InvalidInputError
        For an unknown kind, or values that do not fit.
    """
    return _build("fitted scale", FITTED, json)


def settings_from_json(json: Mapping[str, Any]) -> Scale:
    """Read a scale's settings from `to_json`'s object.

    Parameters
    ----------
    json
        The object.

    Raises
    ------
    InvalidInputError
        For an unknown kind, or values that do not fit.
    """
    return _build("scale", SCALES, json)


def _build(name: str, kinds: Mapping[str, type[_Kind]], json: Mapping[str, Any]) -> _Kind:
    """Build what a JSON object with its `kind` describes."""
    values = dict(json)
    kind = values.pop("kind", None)
    if kind not in tuple(kinds):
        raise InvalidInputError(f"{name}: expected a kind of {sorted(kinds)}, found {kind!r}")
    try:
        return kinds[kind](**values)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name} {kind!r}: {error}") from None


def _check_numbers(values: ArrayLike) -> NDArray[np.float64]:
    """Return a vector without NaN; infinity is allowed."""
    numbers = np.asarray(values, dtype=np.float64)
    if numbers.ndim != 1 or np.isnan(numbers).any():
        raise InvalidInputError(
            f"uncertainty: expected one number per pair, none NaN, found shape {numbers.shape}"
        )
    return numbers


def _check_finite(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return a vector of one finite number or more."""
    numbers = np.asarray(values, dtype=np.float64)
    if numbers.ndim != 1 or not numbers.size or not np.isfinite(numbers).all():
        raise InvalidInputError(
            f"{name}: expected one finite number or more, found shape {numbers.shape} "
            f"with {np.count_nonzero(~np.isfinite(numbers))} not finite"
        )
    return numbers
