"""LCoR estimated from a sample: how exact it is, when to trust that, and what sample would do."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

_QUANTILE = 3.2905
"""99.9 % of a normal distribution lie within so many standard deviations of its mean."""
_MIN_SUPPORT = 512.0
_MAX_INFLUENCE = 0.1
"""Beyond these two, more than 1 in 200 answers were seen to be off by more than the half-width."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """LCoR of m queries and how exact it is; every field is (m,).

    values are LCoR, deviation their standard deviation over samples, and floor the part of the
    99.9 % half-width that no larger sample lowers. effective_sample_size is as in `Sums`. support
    is how many references of the sample decide the answer: the sample's effective size by weight,
    or by how rare the leverages are that differ from the others, whichever is less. influence is
    the share of the whole weight that one more reference in the query's place would have.
    """

    values: NDArray[np.float64]
    deviation: NDArray[np.float64]
    floor: NDArray[np.float64]
    effective_sample_size: NDArray[np.float64]
    support: NDArray[np.float64]
    influence: NDArray[np.float64]

    @property
    def half_width(self) -> NDArray[np.float64]:
        """Half the width of the 99.9 % confidence interval, (m,): smaller is more exact."""
        return _QUANTILE * self.deviation + self.floor

    @property
    def is_trusted(self) -> NDArray[np.bool_]:
        """Whether enough references decide for the normal approximation to hold, (m,)."""
        return (self.support >= _MIN_SUPPORT) & (self.influence <= _MAX_INFLUENCE)

    def find_size(self, tolerance: float, size: int, count: int) -> NDArray[np.float64]:
        """Return how large a sample would answer within a tolerance.

        Parameters
        ----------
        tolerance
            Largest half-width wanted, > 0, in units of leverage.
        size
            References in the sample that gave these estimates.
        count
            References there are.

        Returns
        -------
        NDArray
            Sizes (m,); infinite where no sample is enough.
        """
        room = np.maximum(tolerance - self.floor, 0) / _QUANTILE
        with np.errstate(divide="ignore", invalid="ignore"):
            # the variance of a sample without replacement is in proportion to 1 / size − 1 / count
            inverse = 1 / count + (room / self.deviation) ** 2 * (1 / size - 1 / count)
            exact_enough = np.where(self.half_width <= tolerance, size, 1 / inverse)
            supported = size * _MIN_SUPPORT / self.support
        return np.where(
            self.influence <= _MAX_INFLUENCE, np.maximum(exact_enough, supported), np.inf
        )

    @classmethod
    def empty(cls, count: int) -> Estimate:
        """Return an estimate to be filled in by `write`.

        Parameters
        ----------
        count
            Number m of queries.
        """
        return cls(*np.empty((len(fields(cls)), count)))

    def write(self, rows: NDArray[np.int64], answers: Estimate) -> None:
        """Write the estimates of some queries into this one.

        Parameters
        ----------
        rows
            Indices of the queries.
        answers
            Their estimates, in the same order.
        """
        for field in fields(self):
            getattr(self, field.name)[rows] = getattr(answers, field.name)

    def take(self, rows: NDArray[np.bool_]) -> Estimate:
        """Return the estimates of some of the queries.

        Parameters
        ----------
        rows
            Mask (m,) of the queries wanted.
        """
        return Estimate(*(getattr(self, field.name)[rows] for field in fields(self)))
