"""What a leverage field answers: LCoR, how far it can be trusted, and what it rests on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels import Estimate, Sums


@dataclass(frozen=True, eq=False)
class Contributors:
    """The demonstration states that contributed most to each of m values, heaviest first.

    Parameters
    ----------
    row:
        (m, c) their rows in the field, which are the rows of the dataset's pairs.
    share:
        (m, c) the part in (0, 1] of the value's total kernel weight that each has.
    """

    row: NDArray[np.int64]
    share: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LCoR:
    """LCoR (leverage constraint reward) of m states: near 1 is expert-like, near 0 is not.

    Parameters
    ----------
    values:
        (m,) LCoR, the weighted mean of the demonstrations' leverage around each state; it lies
        between the smallest and the largest leverage.
    effective_sample_size:
        (m,) how many demonstration states a value rests on, from 1 to n. Close to the
        data few decide. Nearly n mean that no demonstration is nearer than the others: the state
        is far from all, and the value is only the mean leverage of the dataset.
    half_width:
        (m,) 0 where the value is exact. Where a random part of the demonstrations was used, the
        exact value lies within the half-width with a chance of 99.9 %, as far as the normal
        approximation holds, and the effective sample size is an estimate.
    contributors:
        The demonstration states that weigh most; c = 0 of them unless they were requested.

    Examples
    --------
    >>> field = dataset.field("vae")
    >>> answer = field.lcor(field.states[:4], contributors=2)
    >>> answer.values.shape, answer.contributors.row.shape
    ((4,), (4, 2))
    >>> bool((answer.half_width == 0).all())  # exact
    True
    """

    values: NDArray[np.float64]
    effective_sample_size: NDArray[np.float64]
    half_width: NDArray[np.float64]
    contributors: Contributors

    @classmethod
    def of_sums(cls, sums: Sums) -> LCoR:
        """Return exact values.

        Parameters
        ----------
        sums:
            Over all demonstration states.
        """
        return cls(
            values=sums.values,
            effective_sample_size=sums.effective_sample_size,
            half_width=np.zeros(len(sums.values)),
            contributors=Contributors(
                row=sums.nearest, share=sums.nearest_weight / sums.denominator[:, None]
            ),
        )

    @classmethod
    def of_estimate(cls, found: Estimate) -> LCoR:
        """Return the values that a sample gave; it names no contributors.

        Parameters
        ----------
        found:
            From a random part of the demonstration states.
        """
        none = np.empty((len(found.values), 0))
        return cls(
            values=found.values,
            effective_sample_size=found.effective_sample_size,
            half_width=found.half_width,
            contributors=Contributors(row=none.astype(np.int64), share=none),
        )
