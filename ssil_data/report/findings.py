"""Segments to look at first: the least trusted with the reason, and the most disputed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.report.evidence import Evidence
from ssil_data.report.reasons import Reason, Reasons
from ssil_data.report.segments import Windows, correlations, rank_among, windows
from ssil_data.scoring import LeverageModel, Progress

SHOWN = 20
PER_EPISODE = 2


@dataclass(frozen=True)
class Segment:
    """Steps `first` to `last` of an episode, which are `rows` of the pairs."""

    episode: int
    first: int
    last: int
    group: str
    source: str
    rows: slice


@dataclass(frozen=True)
class Distrust:
    """A segment, its mean leverage and uncertainty under a run, and why it is distrusted."""

    segment: Segment
    leverage: float
    uncertainty: float
    reason: Reason


@dataclass(frozen=True)
class Dispute:
    """A segment and its standing under each run: the share of unlabeled pairs trusted less."""

    segment: Segment
    standings: list[float]


def least_trusted(evidence: Evidence, progress: Progress) -> dict[str, list[Distrust]]:
    """Return the unlabeled segments of the least leverage by the key of the run.

    Of leverage that is equal as shown, to two decimals, the more uncertain first.
    """
    every = windows(evidence.lengths, ~evidence.labeled)
    leverage = {run.key: every.means(run.leverage).round(2) for run in evidence.runs}
    uncertainty = {run.key: every.means(run.uncertainty) for run in evidence.runs}
    found = {
        key: every.least(leverage[key], -uncertainty[key], count=SHOWN, per_episode=PER_EPISODE)
        for key in leverage
    }
    segments = {key: [_segment(evidence, every, at) for at in found[key]] for key in found}
    episodes = {one.episode for some in segments.values() for one in some}
    reasons = Reasons(evidence.dataset, sorted(episodes))
    answer = {}
    for number, run in enumerate(evidence.runs):
        progress("explain", number, len(evidence.runs))
        model = LeverageModel.of(evidence.dataset, run.name)
        answer[run.key] = [
            Distrust(
                segment=one,
                leverage=float(leverage[run.key][at]),
                uncertainty=float(uncertainty[run.key][at]),
                reason=reasons(model, run, one.rows, episode=one.episode, first=one.first),
            )
            for at, one in zip(found[run.key], segments[run.key], strict=True)
        ]
    progress("explain", len(evidence.runs), len(evidence.runs))
    return answer


def disputes(evidence: Evidence) -> tuple[NDArray[np.float64], list[Dispute]]:
    """Return Spearman's correlation of each of r runs with each, (r, r), and where they differ.

    Those segments come first whose standings under two runs lie furthest apart. Over unlabeled
    pairs.
    """
    every = windows(evidence.lengths, ~evidence.labeled)
    unlabeled = ~evidence.per_pair(evidence.labeled)
    standings = np.stack([rank_among(run.leverage, unlabeled) for run in evidence.runs])
    means = np.stack([every.means(values) for values in standings])
    least = means.min(axis=0)
    found = every.least(least - means.max(axis=0), least, count=SHOWN, per_episode=PER_EPISODE)
    return correlations(standings[:, unlabeled]), [
        Dispute(_segment(evidence, every, at), means[:, at].tolist()) for at in found
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
