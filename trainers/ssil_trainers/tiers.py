"""Which under-trained policies stand for which quality tier, from measured scores alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import NotFoundError

EXPERT = "expert"


@dataclass(frozen=True)
class Band:
    """Scores from `low` to below `high`; 1 is the expert's mean return."""

    tier: str
    low: float
    high: float

    def __contains__(self, score: float) -> bool:
        """Tell whether a score lies in the band."""
        return bool(self.low <= score < self.high)


BANDS = (Band("0-25", 0.0, 0.25), Band("25-50", 0.25, 0.50), Band("50-75", 0.50, 0.75))


def pick(measured: Sequence[ArrayLike], band: Band, *, at_most: int) -> list[int]:
    """Return which policies stand for a band: at most `at_most`, spread evenly over their means.

    measured holds the episode scores of each policy. Its mean must lie in the band, and so must
    at least half of its episodes: a driver that crashes at once or finishes has a middling mean
    but no middling episode. Raises NotFoundError if there is none.
    """
    scores = [np.asarray(of_policy, dtype=np.float64) for of_policy in measured]
    fit = [row for row, of_policy in enumerate(scores) if _belongs(of_policy, band)]
    if not fit:
        means = ", ".join(f"{of_policy.mean():.2f}" for of_policy in scores)
        raise NotFoundError(
            f"policy of tier {band.tier}: expected one whose mean and half of whose episodes "
            f"score from {band.low:.2f} to {band.high:.2f}, found none among the means [{means}]; "
            "train more runs or take another seed"
        )
    fit.sort(key=lambda row: scores[row].mean())
    places = np.linspace(0, len(fit) - 1, min(at_most, len(fit)))
    return [fit[round(place)] for place in places]


def _belongs(scores: NDArray[np.float64], band: Band) -> bool:
    inside = sum(score in band for score in scores)
    return scores.mean() in band and 2 * inside >= len(scores)
