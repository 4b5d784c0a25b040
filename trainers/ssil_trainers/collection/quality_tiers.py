"""Quality tiers: bands of scores, and the name of the best one."""

from __future__ import annotations

from dataclasses import dataclass

EXPERT = "expert"
"""Tier of the expert's episodes, which has no band: its mean score is 1 by definition."""


@dataclass(frozen=True)
class Band:
    """The scores of a tier; a score is a return over the expert's mean return.

    Parameters
    ----------
    tier:
        Name of the tier.
    low:
        Lowest score of the band.
    high:
        Score at which the next band begins.

    Examples
    --------
    >>> from ssil_trainers.collection.quality_tiers import Band
    >>> 0.25 in Band("25-50", 0.25, 0.5), 0.5 in Band("25-50", 0.25, 0.5)
    (True, False)
    """

    tier: str
    low: float
    high: float

    def __contains__(self, score: float) -> bool:
        """Tell whether a score lies in the band."""
        return bool(self.low <= score < self.high)
