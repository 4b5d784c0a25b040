"""Which under-trained policies stand for which quality tier, from measured scores alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

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


def select_policies(measured: Sequence[ArrayLike], band: Band, *, at_most: int) -> list[int]:
    """Return which policies stand for a band: at most `at_most`, spread evenly over their means.

    measured holds the episode scores of each policy. Its mean must lie in the band, and so must
    half of its episodes, or as many as any such policy manages: a driver that crashes at once or
    finishes has a middling mean but no middling episode. Raises NotFoundError if there is none.
    """
    scores = [np.asarray(of_policy, dtype=np.float64) for of_policy in measured]
    middling = [row for row, of_policy in enumerate(scores) if of_policy.mean() in band]
    inside = {row: np.mean([score in band for score in scores[row]]) for row in middling}
    enough = min(0.5, max(inside.values(), default=0.0))
    if not enough:
        raise NotFoundError(
            f"policy of tier {band.tier}: expected one with a mean and an episode from "
            f"{band.low:.2f} to {band.high:.2f}, found {len(middling)} with the mean and none "
            f"with an episode among {len(scores)}; train more runs or take another seed"
        )
    fit = [row for row in middling if inside[row] >= enough]
    fit.sort(key=lambda row: scores[row].mean())
    places = np.linspace(0, len(fit) - 1, min(at_most, len(fit)))
    return [fit[round(place)] for place in places]
