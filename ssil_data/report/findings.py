"""Segments to look at first: the least trusted, with reasons, and those where runs disagree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.report.evidence import Evidence
from ssil_data.report.reasons import Reason, Reasons
from ssil_data.report.segments import Windows, correlate_ranks, cut_windows, rank_among
from ssil_data.scoring import Progress

SHOWN = 20
"""Segments in a table."""
PER_EPISODE = 2
"""Segments of one episode in a table, at most."""


@dataclass(frozen=True)
class Segment:
    """Steps `first` to `last` of an episode, both included; `rows` are its rows among all pairs."""

    episode: int
    first: int
    last: int
    group: str
    source: str
    rows: slice


@dataclass(frozen=True)
class DistrustedSegment:
    """A segment of low leverage: its mean leverage and uncertainty under a run, and the reason."""

    segment: Segment
    leverage: float
    uncertainty: float
    reason: Reason


@dataclass(frozen=True)
class DisputedSegment:
    """A segment that runs disagree about.

    standings has, for each run, the share of unlabeled pairs that it trusts less, averaged over the
    segment.
    """

    segment: Segment
    standings: list[float]


def find_least_trusted(
    evidence: Evidence, progress: Progress
) -> dict[str, list[DistrustedSegment]]:
    """Find the unlabeled segments with the least mean leverage under each run.

    Leverage is compared as it is shown, to two decimals; of equal ones, the more uncertain segment
    comes first.

    Parameters
    ----------
    evidence
        The runs.
    progress
        Called after each run.

    Returns
    -------
    dict
        The segments by the key of the run, least trusted first.
    """
    every = cut_windows(evidence.lengths, ~evidence.labeled)
    leverage = {run.key: every.means(run.leverage).round(2) for run in evidence.runs}
    uncertainty = {run.key: every.means(run.uncertainty) for run in evidence.runs}
    found = {
        key: every.find_least(
            leverage[key], -uncertainty[key], count=SHOWN, per_episode=PER_EPISODE
        )
        for key in leverage
    }
    segments = {key: [_segment(evidence, every, at) for at in found[key]] for key in found}
    episodes = {one.episode for some in segments.values() for one in some}
    reasons = Reasons(evidence.dataset, sorted(episodes))
    answer = {}
    for number, run in enumerate(evidence.runs):
        progress("explain", number, len(evidence.runs))
        model = evidence.dataset.model(run.name)
        answer[run.key] = [
            DistrustedSegment(
                segment=one,
                leverage=float(leverage[run.key][at]),
                uncertainty=float(uncertainty[run.key][at]),
                reason=reasons.explain(model, run, one.rows, episode=one.episode, first=one.first),
            )
            for at, one in zip(found[run.key], segments[run.key], strict=True)
        ]
    progress("explain", len(evidence.runs), len(evidence.runs))
    return answer


def find_disputes(evidence: Evidence) -> tuple[NDArray[np.float64], list[DisputedSegment]]:
    """Compare the runs by how they rank the unlabeled pairs.

    Parameters
    ----------
    evidence
        The r runs.

    Returns
    -------
    matrix
        Spearman's correlation of the leverages of every two runs, (r, r): 1 = ranked alike. NaN for
        a run that gives all pairs one leverage.
    disputes
        The segments whose standings under two runs lie furthest apart, the furthest first.
    """
    every = cut_windows(evidence.lengths, ~evidence.labeled)
    unlabeled = ~evidence.per_pair(evidence.labeled)
    standings = np.stack([rank_among(run.leverage, unlabeled) for run in evidence.runs])
    means = np.stack([every.means(values) for values in standings])
    least = means.min(axis=0)
    found = every.find_least(least - means.max(axis=0), least, count=SHOWN, per_episode=PER_EPISODE)
    return correlate_ranks(standings[:, unlabeled]), [
        DisputedSegment(_segment(evidence, every, at), means[:, at].tolist()) for at in found
    ]


def _segment(evidence: Evidence, every: Windows, at: np.int64) -> Segment:
    place, start, stop = (int(x[at]) for x in (every.episode, every.start, every.stop))
    before = int(evidence.lengths[:place].sum())
    row = evidence.dataset.episodes.slice(place, 1).to_pylist()[0]
    return Segment(
        episode=row["episode"],
        first=start - before,
        last=stop - before - 1,
        group=evidence.groups[evidence.group[place]],
        source=row["source"] or "",
        rows=slice(start, stop),
    )
