"""Which under-trained policies stand for a quality tier, and which of their episodes are kept.

Both are decided from scores alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ssil_data.errors import NotFoundError
from ssil_trainers.collection.ppo import Checkpoint
from ssil_trainers.collection.quality_tiers import Band
from ssil_trainers.collection.recording import EvaluationCourse, RecordedEpisode


def select_policies(scores: Sequence[ArrayLike], band: Band, *, at_most: int) -> list[int]:
    """Return which policies stand for a band, spread evenly over their mean scores.

    A policy's mean must lie in the band, and so must half of its episodes, or as many as any such
    policy manages: a policy that either crashes at once or finishes has a middling mean but no
    middling episode.

    Parameters
    ----------
    scores:
        Episode scores of each policy.
    band:
        The band of the tier.
    at_most:
        Most policies that are returned.

    Returns
    -------
    list of int
        Rows of the policies, by rising mean score.

    Raises
    ------
    NotFoundError
        If no policy has its mean and one episode in the band.

    Examples
    --------
    >>> from ssil_trainers.collection.policy_selection import select_policies
    >>> from ssil_trainers.collection.quality_tiers import Band
    >>> select_policies([[0.0, 0.8], [0.3, 0.4]], Band("25-50", 0.25, 0.5), at_most=2)
    [1]
    """
    of_policies = [np.asarray(of_policy, dtype=np.float64) for of_policy in scores]
    middling = [row for row, of_policy in enumerate(of_policies) if of_policy.mean() in band]
    inside = {row: np.mean([score in band for score in of_policies[row]]) for row in middling}
    enough = min(0.5, max(inside.values(), default=0.0))
    if not enough:
        raise NotFoundError(
            f"tier {band.tier}: no policy stands for scores from {band.low:.2f} to "
            f"{band.high:.2f}; of {len(of_policies)} policies, {len(middling)} have their mean "
            "there, none of these an episode; train more runs or take another seed"
        )
    fit = [row for row in middling if inside[row] >= enough]
    fit.sort(key=lambda row: of_policies[row].mean())
    places = np.linspace(0, len(fit) - 1, min(at_most, len(fit)))
    return [fit[round(place)] for place in places]


def episodes_within(
    band: Band,
    drivers: Sequence[Checkpoint],
    course: EvaluationCourse,
    *,
    expert_return: float,
    patience: int,
) -> Iterator[RecordedEpisode]:
    """Yield episodes that score inside a band; the policy with fewest steps so far drives next.

    Parameters
    ----------
    band:
        The band of the tier.
    drivers:
        Policies that stand for it.
    course:
        Where they drive.
    expert_return:
        Return that scores 1.
    patience:
        Steps that are driven without such an episode before giving up.

    Raises
    ------
    NotFoundError
        When more than `patience` steps were driven since the last such episode.

    Examples
    --------
    A driver that never steers survives less than half a lap:

    >>> from ssil_trainers.collection.policy_selection import episodes_within
    >>> from ssil_trainers.collection.ppo import Checkpoint
    >>> from ssil_trainers.collection.quality_tiers import Band
    >>> from ssil_trainers.collection.recording import EvaluationCourse
    >>> from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
    >>> layer = (np.zeros((1, 20), dtype=np.float32), np.zeros(1, dtype=np.float32))
    >>> drivers = [Checkpoint("straight on", 0, (layer,))]
    >>> found = episodes_within(
    ...     Band("0-50", 0.0, 0.5), drivers, EvaluationCourse(RCLidarEnv("hall")),
    ...     expert_return=400.0, patience=1_000,
    ... )
    >>> next(found).ending
    'terminated'
    """
    steps = [0] * len(drivers)
    since = 0
    while since <= patience:
        turn = int(np.argmin(steps))
        episode = course.drive(drivers[turn])
        steps[turn] += len(episode)
        since += len(episode)
        if episode.total_reward / expert_return in band:
            yield episode
            since = 0
    names = ", ".join(map(str, drivers))
    raise NotFoundError(
        f"tier {band.tier}: no episode scored from {band.low:.2f} to {band.high:.2f} within "
        f"{patience} steps of {names}; take another seed or train more runs"
    )
