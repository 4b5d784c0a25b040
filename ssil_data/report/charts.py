"""Histograms, timelines and agreement as Vega-Lite specifications.

Names that users gave to runs, tiers and sources are data, never fields or expressions: the runs are
fields r0, r1, …, and the parameter `run` says which is shown. Leverage is in whole percent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any

import altair as alt

from ssil_data.report.bins import Rows, Strips
from ssil_data.report.style import (
    WIDTH,
    Spec,
    build_spec,
    leverage_color,
    run_parameters,
    run_title,
    title,
)


def draw_histograms(rows: Rows, runs: Sequence[str], groups: Sequence[str]) -> Spec:
    """Draw histograms of leverage, a column for each run, a row for each group.

    Parameters
    ----------
    rows
        Of each bar: run, group, low, middle and high of the bin in [0, 1], share in percent.
    runs
        Names of the runs, in order.
    groups
        Names of the groups, in order.
    """
    across = ceil(len(runs) / ceil(len(runs) / 6))
    width = min(240, (WIDTH - 140) // across - 14)
    parts = [runs[first : first + across] for first in range(0, len(runs), across)]
    bars = (
        alt.Chart()
        .mark_bar(binSpacing=0)
        .encode(
            x=alt.X("low:Q", bin="binned", title="Leverage", axis=alt.Axis(values=[0, 0.5, 1])),
            x2="high:Q",
            y=alt.Y(
                "share:Q",
                title=None,
                scale=alt.Scale(
                    type="sqrt", domain=[0, max(row["share"] for row in rows)], nice=False
                ),
                axis=alt.Axis(values=[0, 10, 50, 100]),
            ),
            color=leverage_color("middle:Q", legend=False),
            tooltip=[
                alt.Tooltip("run:N", title="Run"),
                alt.Tooltip("group:N", title="Group"),
                alt.Tooltip("low:Q", title="Leverage from", format=".2f"),
                alt.Tooltip("high:Q", title="to", format=".2f"),
                alt.Tooltip("share:Q", title="% of the group's pairs", format=".1f"),
            ],
        )
        .properties(width=width, height=60)
    )
    grids = [
        bars.transform_filter(alt.FieldOneOfPredicate("run", list(part))).facet(
            data=alt.NamedData("histograms"),
            column=alt.Column("run:N", sort=list(part), title=None, header=_header(width)),
            row=alt.Row(
                "group:N", sort=list(groups), title="Share of pairs, %", header=_row_header()
            ),
            spacing={"row": 8, "column": 14},
        )
        for part in parts
    ]
    chart = alt.vconcat(*grids, title=title("Leverage by group and run"))
    return build_spec(chart, {"histograms": rows})


def draw_timelines(
    strips: Strips, names: Mapping[str, str], shown: str, *, alone: Mapping[str, str]
) -> Spec:
    """Draw episodes as strips of leverage over time, under the run that is shown.

    Where a run pools, two charts: leverage of each pair judged alone, and pooled over time.

    Parameters
    ----------
    strips
        The episodes, laid out.
    names
        Names of the runs by key.
    shown
        Key of the run that is shown first.
    alone
        By the key of each run that pools, the key of its pairs judged alone; empty for none.
    """
    data = {"strips": strips.rows, "labels": strips.labels}
    parameters = run_parameters(names, shown)
    if alone:
        flat = [*names, *alone.values()]
        parts = {key: alone.get(key, key) for key in names}
        parameters.append(alt.param(name="alone", value=parts))
        left = _draw_strips(strips, flat, "datum[alone[run]] / 100")
        right = _draw_strips(strips, flat, "datum[run] / 100", labels=False)
        chart: Any = alt.hconcat(
            left.properties(title=title("each pair alone")),
            # as high above the strips as the left one, which stands above an axis title
            right.properties(title=title("pooled over time: the leverage", offset=32)),
            title=run_title("Leverage over time"),
        )
    else:
        chart = _draw_strips(strips, [*names], "datum[run] / 100")
        chart = chart.properties(title=run_title("Leverage over time"))
    return build_spec(chart.add_params(*parameters), data)


def _draw_strips(strips: Strips, flat: Sequence[str], leverage: str, *, labels: bool = True) -> Any:
    """Draw the strips, colored by an expression of the flattened fields."""
    width = strips.columns * strips.column
    steps = strips.steps
    group = "Group (episodes)" if labels else None
    y = alt.Scale(domain=[0, strips.height], range=[0, strips.height], nice=False)
    cells = (
        alt.Chart(alt.NamedData("strips"))
        .transform_flatten(["b", *flat])
        .transform_calculate(
            leverage=leverage,
            first=f"datum.b * {steps}",
            end=f"(datum.b + 1) * {steps}",
        )
        .mark_rect()
        .encode(
            x=alt.X(
                "first:Q",
                title="Step of the episode",
                scale=alt.Scale(domain=[0, strips.columns * steps], nice=False),
                axis=alt.Axis(grid=False, tickCount=min(10, max(2, width // 70))),
            ),
            x2="end:Q",
            y=alt.Y("y:Q", title=group, axis=_axis_with_title(), scale=y),
            y2="y2:Q",
            color=leverage_color("leverage:Q"),
            tooltip=[
                alt.Tooltip("episode:Q", title="Episode"),
                alt.Tooltip("group:N", title="Group"),
                alt.Tooltip("source:N", title="Source"),
                alt.Tooltip("first:Q", title="From step"),
                alt.Tooltip("leverage:Q", title="Mean leverage", format=".2f"),
            ],
        )
    )
    groups = (
        alt.Chart(alt.NamedData("labels"))
        .mark_text(align="right", baseline="middle", limit=150)
        .encode(x=alt.value(-8), y=alt.Y("y:Q", scale=y), text="name:N")
    )
    layers = (cells, groups) if labels else (cells,)
    return alt.layer(*layers).properties(width=width, height=strips.height)


def draw_agreement(rows: Rows, runs: Sequence[str]) -> Spec:
    """Draw the rank correlations of every two runs.

    Parameters
    ----------
    rows
        Of each cell: run, other, correlation.
    runs
        Names of the runs, in order.
    """
    place = {"scale": alt.Scale(domain=list(runs)), "title": "Run"}
    base = alt.Chart(alt.NamedData("agreement")).encode(
        x=alt.X("run:N", axis=alt.Axis(labelAngle=-30, labelLimit=140), **place),
        y=alt.Y("other:N", axis=alt.Axis(labelLimit=140), **place),
    )
    cells = base.mark_rect().encode(
        color=alt.Color(
            "correlation:Q",
            scale=alt.Scale(domain=[-1, 0, 1], range=["#b35806", "#f7f7f7", "#542788"]),
            legend=alt.Legend(title="Rank correlation", gradientLength=160),
        )
    )
    text = base.mark_text(fontSize=12).encode(
        text=alt.Text("correlation:Q", format=".2f"),
        color=alt.condition("abs(datum.correlation) > 0.6", alt.value("white"), alt.value("#222")),
    )
    chart = alt.layer(cells, text).properties(
        width=alt.Step(58), height=alt.Step(36), title=title("Agreement between runs")
    )
    return build_spec(chart, {"agreement": rows})


def _axis_with_title() -> alt.Axis:
    """Return an axis without ticks, whose title stands over the labels beside it."""
    title = {"titleAngle": 0, "titleAlign": "right", "titleX": -8, "titleY": -8}
    return alt.Axis(labels=False, ticks=False, domain=False, grid=False, **title)


def _header(width: int) -> alt.Header:
    return alt.Header(labelOrient="top", labelLimit=width, labelFontWeight="bold")


def _row_header() -> alt.Header:
    return alt.Header(labelAngle=0, labelAlign="left", labelLimit=110)
