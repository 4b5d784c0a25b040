"""Learning curves and final scores as Vega-Lite specs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import altair as alt
import numpy as np

from ssil_data.report.style import Spec, build_spec, title
from ssil_trainers.experiments import published
from ssil_trainers.experiments.results import Results, learning_curve
from ssil_trainers.experiments.tables import Table

_COLORS = {
    "gail-mixed": "#a3a9b2",
    "gail": "#6b7280",
    "mixgail": "#d1495b",
    "ssil-gpr": "#9b5de5",
    "ssil-mdn": "#e07a1f",
    "ssil-vae": "#2a9d8f",
    "ssil-windowvae": "#2878c8",
    "shuffled-windowvae": "#d4a017",
    "constant": "#b08968",
    "clone": "#8fb996",
    "gail-leverage-windowvae": "#1f2937",
    "ssil-leverage-windowvae": "#0b3d91",
    "clone-mixed": "#c9b458",
    "clone-leverage-windowvae": "#3f7d4f",
}
OTHER_COLOR = "#888888"


def curves(table: Table, results: Results) -> Spec:
    """Draw the mean score over seeds against environment steps, with a band from least to most.

    A cloned policy is not trained further; its score is drawn as a horizontal line.

    Parameters
    ----------
    table:
        The table.
    results:
        Its results.
    """
    rows = [
        {"labels": _name(labels), "method": row.title, **point}
        for labels in table.labels
        for row in table.rows
        for point in _points(results.records_of(table, row, labels), results.budget(table))
    ]
    chosen = alt.selection_point(fields=["method"], bind="legend")
    base = alt.Chart().encode(
        x=alt.X("steps:Q", title="Environment steps", axis=alt.Axis(format="~s", tickCount=6)),
        color=method_color(table),
    )
    band = base.mark_area(opacity=0.16).encode(
        y=alt.Y("least:Q", title="Score where it trains"),
        y2="most:Q",
        opacity=alt.condition(chosen, alt.value(0.16), alt.value(0.0)),
    )
    line = base.mark_line(strokeWidth=1.8, interpolate="linear").encode(
        y="mean:Q",
        opacity=alt.condition(chosen, alt.value(1.0), alt.value(0.12)),
        tooltip=[
            alt.Tooltip("method:N", title="Method"),
            alt.Tooltip("steps:Q", title="Steps", format=","),
            alt.Tooltip("mean:Q", title="Mean", format=".3f"),
            alt.Tooltip("least:Q", title="Least", format=".3f"),
        ],
    )
    whole = alt.Chart().mark_rule(strokeDash=[3, 3], opacity=0.5).encode(y=alt.datum(0.9))
    chart = _facet(alt.layer(band, line, whole), table, "curves", height=250)
    named = chart.properties(title=title("Learning curves: mean over seeds, least to most"))
    return build_spec(named.add_params(chosen), {"curves": rows})


def finals(table: Table, results: Results) -> Spec:
    """Draw interquartile means of final scores with their intervals, and the paper's numbers.

    Parameters
    ----------
    table:
        The table.
    results:
        Its results.
    """
    rows = []
    for labels in table.labels:
        for row in table.rows:
            summary = results.summary(table, row, labels)
            if summary is None:
                continue
            paper, _ = published.SCORES.get((table.name, labels, row.key), (None, None))
            at = {"labels": _name(labels), "method": row.title}
            middle = summary.interquartile_mean
            rows.append(
                {**at, "x": middle, "low": summary.low, "high": summary.high, "paper": paper}
            )
    order = [row.title for row in table.rows]
    place = alt.Y("method:N", sort=order, title=None)
    base = alt.Chart().encode(y=place, color=method_color(table, legend=False))
    interval = base.mark_rule(strokeWidth=3, opacity=0.6).encode(
        x=alt.X("low:Q", title="Score on the real environment"), x2="high:Q"
    )
    middle = base.mark_tick(thickness=3, size=16).encode(x="x:Q")
    diamond = base.mark_point(shape="diamond", size=60, strokeWidth=1.5).encode(
        x="paper:Q", tooltip=[alt.Tooltip("paper:Q", title="Paper", format=".3f")]
    )
    chart = _facet(alt.layer(interval, middle, diamond), table, "finals", height=210)
    text = "Final scores: interquartile mean and 95 % interval; diamonds are the paper's"
    return build_spec(chart.properties(title=title(text)), {"finals": rows})


def _facet(layers: Any, table: Table, data: str, *, height: int) -> Any:
    """Return a panel for each number of labels, two side by side."""
    several = len(table.labels) > 1
    panel = layers.properties(width=440 if several else 860, height=height)
    names = [_name(labels) for labels in table.labels]
    header = alt.Header(title=None, labelFontWeight="bold", labels=several)
    facet = alt.Facet("labels:N", sort=names, header=header)
    return panel.facet(data=alt.NamedData(data), facet=facet, columns=2)


def method_color(table: Table, *, legend: bool = True) -> alt.Color:
    """Return the color scale of a table's methods, each with its own color.

    Parameters
    ----------
    table:
        The table.
    legend:
        Whether to draw a legend, in which a method can be clicked.
    """
    scale = alt.Scale(
        domain=[row.title for row in table.rows],
        range=[_COLORS.get(row.key, OTHER_COLOR) for row in table.rows],
    )
    shown = None
    if legend:
        shown = alt.Legend(title="Click one to see it alone", symbolOpacity=1, symbolType="square")
    return alt.Color("method:N", scale=scale, legend=shown)


def _points(records: Sequence[Mapping[str, Any]], budget: int) -> list[dict[str, float]]:
    """Return mean, least and most of the scores over seeds at each evaluation."""
    if not records:
        return []
    found = [learning_curve(record) for record in records]
    steps = found[0].steps
    scores = np.array([one.scores for one in found])
    if len(steps) == 1:
        steps = (0, budget)
        scores = np.repeat(scores, 2, axis=1)
    columns = zip(steps, scores.mean(0), scores.min(0), scores.max(0), strict=True)
    return [
        {"steps": at, "mean": float(mean), "least": float(least), "most": float(most)}
        for at, mean, least, most in columns
    ]


def _name(labels: int | None) -> str:
    """Name a panel."""
    return "all labels" if labels is None else f"{labels:,} labels"
