"""Labeled pairs that say less of the expert than their number does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.estimators import UnlabeledSample

FEWEST_PAIRS = 30
"""Labeled pairs, or unlabeled ones, below which a run is weak."""
ALIKE = 1e-3
"""Pairs that differ by less, in deviations of the unlabeled pairs, count as one."""
SHARED = 0.01
"""Least share of the unlabeled pairs that must have a value which all labeled pairs have."""
ONE_EPISODE = "all labeled pairs are of one episode: other drives of the expert may look stranger"
"""The one reason that does not keep the purest pairs from joining the labeled ones."""


def find_poor_labels(labeled: Pairs, unlabeled: UnlabeledSample) -> list[str]:
    """Say if labeled pairs repeat each other, or share a value that tells them from all others.

    Parameters
    ----------
    labeled
        The labeled pairs, (m,).
    unlabeled
        A sample of the unlabeled pairs.

    Returns
    -------
    list of str
        The reasons; none if there is nothing against them.
    """
    ours = np.concatenate([labeled.states, labeled.actions], axis=1)
    others = np.concatenate([unlabeled.pairs.states, unlabeled.pairs.actions], axis=1)
    deviation = np.concatenate([unlabeled.state_deviation, unlabeled.action_deviation])
    reasons = []
    distinct = count_distinct(ours, deviation)
    if distinct < FEWEST_PAIRS <= len(ours):
        reasons.append(f"{len(ours)} labeled pairs, but only {distinct} different ones")
    width = labeled.states.shape[1]
    for column in np.flatnonzero(np.ptp(ours, axis=0) == 0):
        if np.mean(others[:, column] == ours[0, column]) < SHARED:
            name = f"state dimension {column}" if column < width else f"action {column - width}"
            reasons.append(
                f"{name} is {ours[0, column]:.7g} in all labeled pairs and hardly ever elsewhere, "
                "which tells them apart whoever drives"
            )
    return reasons


def count_distinct(values: NDArray[np.float32], deviation: NDArray[np.float64]) -> int:
    """Return how many rows differ by more than `ALIKE` deviations.

    Rows are counted on two grids, one half a cell beside the other, so that an edge between two
    rows that are alike does not make two of them.

    Parameters
    ----------
    values
        (n, d).
    deviation
        Of each column, (d,); columns without any are compared in their units.
    """
    cell = ALIKE * np.where(deviation > 0, deviation, 1)
    standard = (values.astype(np.float64) - values[0]) / cell
    grids = (np.floor(standard), np.floor(standard + 0.5))
    return min(len(np.unique(grid, axis=0)) for grid in grids)
