"""Window: the mean rank of a pair and its neighbors in time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.json_kinds import check_fields, shorten, show_short, to_python_number
from ssil_data.pooling.base import FittedPooling, Pooling, find_starts
from ssil_data.ranks import KNOTS, find_knots, normal_scores

UNIT = float(1 << 40)
"""Normal scores are summed as multiples of 1 / `UNIT`."""

WIDEST = 100_000
"""Largest half width: an hour and a half at 20 steps a second."""

LEAST_CORRELATION = 0.1
"""Rank correlation of neighbors below which rows are in no order of time, and nothing is pooled."""


@dataclass(frozen=True)
class Window(Pooling):
    """Mean of normal scores over the pairs up to `half_width` steps before and after.

    Uncertainty becomes the normal score of its rank among unlabeled pairs first, so that one
    outlier does not carry its neighbors along. Where neighbors are no more alike than strangers,
    the rows are in no order of time, and the window closes to the pair alone.

    Parameters
    ----------
    half_width
        Steps to either side; quality that changes faster than this is blurred.

    Raises
    ------
    InvalidInputError
        For a number that is not whole, below 1 or above `WIDEST`.

    Examples
    --------
    >>> noise = np.random.default_rng(0).normal(size=400)
    >>> drive = np.repeat([0, 1], 200)
    >>> pooled = sd.Window().fit(noise + 2 * drive, drive)(noise + 2 * drive, drive)
    >>> bool(pooled[drive == 0].max() < pooled[drive == 1].min())
    True
    """

    kind: ClassVar[str] = "window"
    half_width: int = 25

    def __post_init__(self) -> None:
        """Validate a whole number of steps."""
        object.__setattr__(self, "half_width", to_python_number(self.half_width))
        if not _is_width(self.half_width, least=1):
            raise InvalidInputError(
                f"window: half_width: expected a whole number from 1 to {WIDEST:,}, "
                f"found {show_short(self.half_width)}"
            )

    def fit(self, uncertainty: ArrayLike, episode: NDArray[np.int64]) -> FittedWindow:
        """Remember the ranks of unlabeled pairs, and whether their neighbors are alike.

        Parameters
        ----------
        uncertainty
            Of the unlabeled pairs, (n,).
        episode
            Number of each pair's episode, (n,).
        """
        knots = find_knots(uncertainty)
        scores = normal_scores(uncertainty, knots)
        alike = _correlate_neighbors(scores, find_starts(episode)) >= LEAST_CORRELATION
        return FittedWindow(self.half_width if alike else 0, knots.tolist())


@dataclass(frozen=True)
class FittedWindow(FittedPooling):
    """Pooled r_t = mean of normal scores over t − w … t + w, inside the episode.

    Parameters
    ----------
    half_width
        w, 0 where rows are in no order of time.
    knots
        Quantiles of the unlabeled pairs' uncertainty.

    Raises
    ------
    InvalidInputError
        For knots that fall, or not `KNOTS` of them.
    """

    kind: ClassVar[str] = "window"
    half_width: int
    knots: Sequence[float]

    def __post_init__(self) -> None:
        """Validate the knots and keep them as a tuple."""
        check_fields(self.kind, self)
        with np.errstate(over="ignore"):
            knots = np.asarray(self.knots, dtype=np.float32)
        sound = knots.shape == (KNOTS,) and np.isfinite(knots).all() and (np.diff(knots) >= 0).all()
        if not sound or not _is_width(self.half_width, least=0):
            raise InvalidInputError(
                f"window: expected {KNOTS} rising knots and a half width from 0 to {WIDEST:,}"
            )
        object.__setattr__(self, "knots", shorten(knots))

    @property
    def stretch(self) -> int:
        """The width of the window."""
        return 2 * self.half_width + 1

    def _pool(
        self, uncertainty: NDArray[np.float32], starts: NDArray[np.bool_]
    ) -> NDArray[np.floating]:
        scores = normal_scores(uncertainty, self.knots)
        return average_window(scores, starts, self.half_width)


def average_window(
    values: NDArray[np.float32], starts: NDArray[np.bool_], half_width: int
) -> NDArray[np.float64]:
    """Return the mean over the rows up to `half_width` before and after, inside each episode.

    The sums are of whole numbers and so exact: a row gets the same bits whatever comes before its
    window, in this batch or in another.

    Parameters
    ----------
    values
        (n,), normal scores: none beyond ±`FARTHEST`.
    starts
        Marks the first row of each episode, (n,).
    half_width
        Rows to either side, 0 or more.
    """
    count = len(values)
    whole = np.rint(values.astype(np.float64) * UNIT).astype(np.int64)
    # the running sum may wrap around; differences of it do not mind
    sums = np.concatenate([np.zeros(1, np.int64), np.cumsum(whole)])
    row = np.arange(count)
    bounds = np.append(np.flatnonzero(starts), count)
    number = np.cumsum(starts) - 1
    first = np.maximum(bounds[number], row - half_width)
    stop = np.minimum(bounds[number + 1], row + half_width + 1)
    return (sums[stop] - sums[first]) / (UNIT * (stop - first))


def _is_width(value: object, *, least: int) -> bool:
    """Tell whether a value is a whole number of steps from the least to the most."""
    return isinstance(value, int) and not isinstance(value, bool) and least <= value <= WIDEST


def _correlate_neighbors(scores: NDArray[np.float32], starts: NDArray[np.bool_]) -> float:
    """Return the correlation of a row's score with the next one's; 0 without neighbors."""
    inside = np.flatnonzero(~starts)
    if len(inside) < 3:
        return 0.0
    before = scores[inside - 1].astype(np.float64)
    after = scores[inside].astype(np.float64)
    spread = before.std() * after.std()
    return (
        float(np.mean((before - before.mean()) * (after - after.mean())) / spread)
        if spread
        else 0.0
    )
