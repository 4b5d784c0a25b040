"""The page: charts, tables and prose of a report, put together."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.report import bins, charts
from ssil_data.report.evidence import Evidence, ScoredRun
from ssil_data.report.findings import PER_EPISODE, find_disputes, find_least_trusted
from ssil_data.report.map_chart import draw_map
from ssil_data.report.rendering import render
from ssil_data.report.segments import STEPS
from ssil_data.report.style import Spec
from ssil_data.report.trust import describe_trust
from ssil_data.scoring import Progress

SHOWN_EPISODES = 320
"""Episodes in the timelines: strips of more would be too thin to read."""

ACROSS = 118
"""Cells along the longer side of the map, so that two maps fit side by side."""


def build_page(evidence: Evidence, progress: Progress) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    evidence
        What the page is about.
    progress
        Called after each run that is explained.
    """
    context = _describe_dataset(evidence) | describe_trust(evidence) | _draw_timelines(evidence)
    context["histograms"] = _draw_histograms(evidence)
    context["map"] = _draw_map(evidence)
    context["least_trusted"] = find_least_trusted(evidence, progress)
    context["disputes"] = []
    if len(evidence.runs) > 1 and not evidence.labeled.all():
        matrix, context["disputes"] = find_disputes(evidence)
        context["agreement"] = _draw_agreement(evidence, matrix)
    return render(context)


def _describe_dataset(evidence: Evidence) -> dict[str, Any]:
    """Return what the head of the page and the table of runs say."""
    dataset = evidence.dataset
    table = _tabulate_runs(evidence)
    return {
        "dataset": dataset.name,
        "version": dataset.version,
        "pairs": len(dataset),
        "episodes": len(evidence.lengths),
        "labeled_pairs": int(evidence.lengths[evidence.labeled].sum()),
        "labeled_episodes": int(evidence.labeled.sum()),
        "unlabeled": not evidence.labeled.all(),
        "state_width": len(dataset.state_names),
        "action_width": len(dataset.action_names),
        "groups": evidence.groups,
        "sourced": any(dataset.episodes["source"].to_pylist()),
        "runs": evidence.runs,
        "chosen": evidence.chosen,
        "tiers": bool(evidence.chosen.quality.mean_leverage_by_tier),
        "judged": any(figure["value"] is not None for row in table for figure in row["figures"]),
        "pinned": [run.name for run in evidence.runs if run.run.labeled_is_one],
        "table": table,
        "reasons": {run.key: _describe_reasons(run) for run in evidence.runs},
        "window": STEPS,
        "per_episode": PER_EPISODE,
    }


def _tabulate_runs(evidence: Evidence) -> list[dict[str, Any]]:
    """Return mean leverage by group and figures of quality of each run; the best are marked."""
    names = ("auroc", "auroc_length_matched", "spearman", "spearman_given_length")
    figures = [[_round(getattr(run.quality, name)) for name in names] for run in evidence.runs]
    best = [
        max((value for value in column if value is not None), default=None)
        for column in zip(*figures, strict=True)
    ]
    group = evidence.per_pair(evidence.group)
    sizes = np.bincount(group)
    return [
        {
            "run": run,
            "means": (np.bincount(group, run.leverage) / sizes).tolist(),
            "figures": [
                {"value": value, "best": value is not None and value == most}
                for value, most in zip(row, best, strict=True)
            ],
        }
        for run, row in zip(evidence.runs, figures, strict=True)
    ]


def _round(figure: float | None) -> float | None:
    """Round to what is shown, so that what looks equal counts as equal."""
    return None if figure is None else round(figure, 3)


def _describe_reasons(run: ScoredRun) -> str:
    """Return a sentence on what the reasons of a run's segments mean."""
    settings = run.run.estimator
    kinds = {settings["kind"], *(member["kind"] for member in settings.get("members") or ())}
    if kinds & {"vae", "windowvae"}:
        return (
            "The reason names the state dimensions with the largest shares of the squared "
            "reconstruction error" + (" of the members that have one." if len(kinds) > 1 else ".")
        )
    beyond = "dimensions beyond the labeled pairs' range, the furthest first."
    if not run.parts:
        return f"The reason names the state {beyond}"
    if settings.get("surprisal"):
        first = "The experts would hardly have taken this action in this state"
    else:
        first = "What the experts would do in this state is uncertain"
    return (
        f"{first}: epistemic = the state is unlike the labeled ones, aleatoric = the experts' own "
        f"actions vary there. Then come the {beyond}"
    )


def _draw_histograms(evidence: Evidence) -> Spec:
    group = evidence.per_pair(evidence.group)
    rows: bins.Rows = [
        {
            "run": run.name,
            "group": name,
            "low": bin / bins.BINS,
            "high": (bin + 1) / bins.BINS,
            "middle": (bin + 0.5) / bins.BINS,
            "share": share,
        }
        for run in evidence.runs
        for number, name in enumerate(evidence.groups)
        for bin, share in enumerate(bins.histogram(run.leverage[group == number]))
    ]
    return charts.draw_histograms(rows, [run.name for run in evidence.runs], evidence.groups)


def _draw_timelines(evidence: Evidence) -> dict[str, Any]:
    """Draw the episodes of the least mean leverage under the chosen run, group by group."""
    first = np.cumsum(evidence.lengths) - evidence.lengths
    means = np.add.reduceat(evidence.chosen.leverage, first, dtype=np.float64) / evidence.lengths
    order = np.argsort(means, kind="stable")[:SHOWN_EPISODES]
    groups = [order[evidence.group[order] == number] for number in range(len(evidence.groups))]
    alone = {f"{key}alone": values for key, values in evidence.alone.items()}
    strips = bins.lay_out_strips(
        evidence.lengths,
        groups,
        evidence.groups,
        evidence.leverage | alone,
        width=500 if alone else 1000,
    )
    table = evidence.dataset.episodes
    for row in strips.rows:
        place = row.pop("i")
        row["episode"] = table["episode"][place].as_py()
        row["source"] = table["source"][place].as_py()
        row["group"] = evidence.groups[evidence.group[place]]
    return {
        "timelines": charts.draw_timelines(
            strips,
            evidence.names,
            evidence.chosen.key,
            alone={key: f"{key}alone" for key in evidence.alone},
        ),
        "pools": bool(alone),
        "shown": len(order),
        "hidden": len(means) - len(order),
        "steps": strips.steps,
    }


def _draw_map(evidence: Evidence) -> dict[str, Any] | None:
    positions = evidence.dataset.read_recorded("position")
    if positions is None:
        return None
    group = evidence.per_pair(evidence.group)
    grid = bins.build_grid(positions, group, len(evidence.groups), evidence.leverage, across=ACROSS)
    chart = draw_map(grid, evidence.groups, evidence.names, evidence.chosen.key)
    return {"chart": chart, "cell": grid.cell}


def _draw_agreement(evidence: Evidence, matrix: NDArray[np.float64]) -> Spec:
    names = [run.name for run in evidence.runs]
    rows: bins.Rows = [
        {"run": names[i], "other": names[j], "correlation": round(float(matrix[i, j]), 3)}
        for i, j in np.argwhere(np.isfinite(matrix))
    ]
    return charts.draw_agreement(rows, names)
