"""What is asked of a leverage field beside the states, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.kernels import Estimate, Sums


@dataclass(frozen=True)
class Accuracy:
    """How exact answers must be: wholly, to a tolerance, or as exact as some seconds allow.

    Without a tolerance or seconds, all demonstration states are asked. Raises InvalidInputError for
    numbers that are not finite and positive, and for options that contradict each other.

    Parameters
    ----------
    tolerance:
        Ask a random part of the pairs, large enough for 99.9 % half-widths of at most this.
    relative:
        Take the tolerance in deviations of LCoR over the demonstrations.
    seconds:
        Ask as large a random part of the pairs as this time allows, reading all pairs once before
        not counted; never twice the same.
    seed:
        Equal seeds ask equal parts.
    """

    tolerance: float | None = None
    relative: bool = False
    seconds: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        """Validate."""
        for name in ("tolerance", "seconds"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InvalidInputError(f"{name}: expected a finite number > 0, found {value}")
        if self.tolerance is not None and self.seconds is not None:
            raise InvalidInputError("accuracy: expected a tolerance or seconds, found both")
        if self.relative and self.tolerance is None:
            raise InvalidInputError("relative: expected a tolerance with it, found none")
        if self.seed < 0:
            raise InvalidInputError(f"seed: expected at least 0, found {self.seed}")
        if self.seed and self.exact:
            raise InvalidInputError(
                f"seed: expected a tolerance or seconds with it, found {self.seed} alone"
            )

    @property
    def exact(self) -> bool:
        """Tell whether all states must be asked."""
        return self.tolerance is None and self.seconds is None


@dataclass(frozen=True, eq=False)
class Contributors:
    """The demonstration states that contributed most to each of m answers, most first.

    row (m, c) is their place in the field, share (m, c) the part of the answer's weight.
    """

    row: NDArray[np.int64]
    share: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LCoR:
    """Answers to m queries, each (m,): LCoR in [min l, max l], and how many states it rests on.

    `half_width` is 0 where all demonstration states were asked. Where a random part of them was,
    LCoR over all lies within it of the value with a chance of 99.9 %, as far as the normal
    approximation holds, and the effective sample size is an estimate.
    """

    values: NDArray[np.float64]
    effective_sample_size: NDArray[np.float64]
    half_width: NDArray[np.float64]
    contributors: Contributors

    @classmethod
    def of_sums(cls, sums: Sums) -> LCoR:
        """Return the answers that exact sums make."""
        share = sums.nearest_weight / sums.denominator[:, None]
        contributors = Contributors(sums.nearest, share)
        width = np.zeros(len(sums.values))
        return cls(sums.values, sums.effective_sample_size, width, contributors)

    @classmethod
    def of_estimate(cls, found: Estimate) -> LCoR:
        """Return the answers that a sample gave; it names no contributors."""
        none = np.empty((len(found.values), 0))
        contributors = Contributors(none.astype(np.int64), none)
        return cls(found.values, found.effective_sample_size, found.half_width, contributors)
