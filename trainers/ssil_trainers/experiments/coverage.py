"""How much of a track the labeled pairs cover, beside their number."""

from __future__ import annotations

import numpy as np

from ssil_data.surface import DatasetLike


def count_laps(dataset: DatasetLike, lap: float) -> float | None:
    """Return how many laps the labeled pairs cover: the distance driven in them over that of a lap.

    The paper's 100 to 1,200 labels are 4 to 50 % of one trajectory of 2,400 pairs; as many pairs of
    another simulator can be several laps, which leave nothing of the track unseen.

    Parameters
    ----------
    dataset:
        Demonstrations with positions.
    lap:
        Length of a lap, in the unit of the positions.

    Returns
    -------
    :
        Laps; None if no positions are recorded.

    Examples
    --------
    >>> count_laps(dataset, lap=100.0) is None  # no positions are recorded
    True
    """
    positions = dataset.read_recorded("position")
    if positions is None:
        return None
    episode = dataset.pairs().episode
    labeled = dataset.per_pair("labeled").astype(bool)
    driven = (episode[1:] == episode[:-1]) & labeled[1:]
    steps = np.linalg.norm(np.diff(positions.astype(np.float64), axis=0), axis=1)
    return float(steps[driven].sum() / lap)
