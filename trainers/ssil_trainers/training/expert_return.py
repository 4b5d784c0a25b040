"""The expert's return, which makes a score of 1: as recorded, and without the noise on its actions.

The drivers of the demonstrations act by their mean action plus noise, a trained policy by its mean
action alone. An expert's return without the noise is measured by driving it so; a dataset does not
tell. `expert_returns.json` has what was measured for the committed sets, found again by the return
that they record, so that it holds for a copy of one, or one with fewer labels, under any name.
"""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ssil_data.surface import DatasetLike

_SAME = 1e-6
"""Relative difference of two sums of the same rewards."""


@cache
def measured_returns() -> list[dict[str, Any]]:
    """Return what was measured: for each expert `recorded`, `without_noise` and how.

    Examples
    --------
    >>> [each["dataset"] for each in measured_returns()]
    ['racetrack', 'rc-lidar']
    """
    return json.loads(Path(__file__).with_name("expert_returns.json").read_text("utf-8"))


def without_noise(recorded: float) -> float:
    """Return an expert's mean return without noise on its actions; as recorded if not measured.

    Parameters
    ----------
    recorded:
        The mean return in the demonstrations, with the noise.

    Examples
    --------
    >>> round(without_noise(19_540.81447875897) / 19_540.81447875897, 3)
    1.043
    >>> without_noise(123.0)  # nobody drove this expert without
    123.0
    """
    for each in measured_returns():
        if math.isclose(each["recorded"], recorded, rel_tol=_SAME):
            return each["without_noise"]
    return recorded


def measure_expert_return(dataset: DatasetLike) -> float | None:
    """Return the expert's mean return as it was recorded; for evaluation only.

    An episode's recorded score is its return over the expert's. The expert's return is therefore
    the median of return / score over whole episodes.

    Parameters
    ----------
    dataset:
        The demonstrations.

    Returns
    -------
    :
        The expert's return; None if no reward or score is recorded, or every episode was cut.

    Examples
    --------
    >>> measure_expert_return(dataset) is None  # no rewards are recorded
    True
    """
    rewards = dataset.read_recorded("reward")
    if rewards is None:
        return None
    lengths = dataset.episodes["length"].to_numpy()
    totals = np.add.reduceat(rewards.astype(np.float64), np.cumsum(lengths) - lengths)
    whole = [
        total / row["score"]
        for total, row in zip(totals, dataset.episodes.to_pylist(), strict=True)
        if row["score"] and row["ending"] != "cut"
    ]
    return float(np.median(whole)) if whole else None
