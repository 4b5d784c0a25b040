"""Whether leverage is a chance: of pairs with leverage .8, are four in five the expert's?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError

BINS = 10
"""Bins of a calibration curve, of about equal numbers of pairs."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """What leverage says of pairs, and what is true of them, bin by bin from low leverage to high.

    Parameters
    ----------
    leverage
        Mean leverage of each bin, (b,).
    expert_share
        True share of expert pairs in it, (b,).
    pairs
        How many pairs it has, (b,).
    """

    leverage: NDArray[np.float64]
    expert_share: NDArray[np.float64]
    pairs: NDArray[np.int64]

    @property
    def error(self) -> float:
        """Mean absolute difference of the two over all pairs; 0 is best."""
        return float(np.average(np.abs(self.leverage - self.expert_share), weights=self.pairs))


def find_calibration(expert: NDArray[np.floating], negative: NDArray[np.floating]) -> Calibration:
    """Compare leverage with the share of experts, over `BINS` bins of about equal numbers of pairs.

    Pairs of equal leverage are in one bin, so that there may be fewer and larger ones.

    Parameters
    ----------
    expert, negative
        Leverage of expert and of other pairs, (n,) and (m,), at least one together, none NaN.

    Raises
    ------
    InvalidInputError
        For NaN, which is in no bin.
    """
    values = refuse_nan("leverage", np.concatenate([expert, negative]))
    edges = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)[1:-1]))
    place = np.searchsorted(edges, values, side="right")
    pairs = np.bincount(place)
    sums = np.bincount(place, values)
    experts = np.bincount(place[: len(expert)], minlength=len(pairs))
    filled = pairs > 0
    return Calibration(
        leverage=sums[filled] / pairs[filled],
        expert_share=experts[filled] / pairs[filled],
        pairs=pairs[filled],
    )


def refuse_nan(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return numbers as float64; NaN is refused, as sorting would rank it above all others.

    Parameters
    ----------
    name
        What the message calls them.
    values
        (n,).

    Raises
    ------
    InvalidInputError
        For NaN; the message says where the first one is.
    """
    numbers = np.asarray(values, dtype=np.float64)
    rows = np.flatnonzero(np.isnan(numbers))
    if len(rows):
        raise InvalidInputError(
            f"{name}: expected numbers, found nan at row {rows[0]}, {len(rows):,} in all"
        )
    return numbers
