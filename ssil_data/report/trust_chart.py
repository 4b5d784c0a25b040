"""Calibration and estimated expert shares as a Vega-Lite specification."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import altair as alt

from ssil_data.report.bins import Rows
from ssil_data.report.style import Spec, build_spec, run_parameters, run_title, title

SIDE = 260
"""Pixels of a side of the calibration curve."""
BLUE = "#2f7fc1"
ORANGE = "#d9731a"


def draw_trust(curves: Rows, shares: Rows, names: Mapping[str, str], shown: str) -> Spec:
    """Draw the calibration curve of the run that is shown, and the expert share of every run.

    Parameters
    ----------
    curves
        Of each bin of each run: key of the run, leverage, truth, pairs; empty without tiers.
    shares
        Of each run that estimates one: run, share, low, high, truth; empty for none.
    names
        Names of the runs by key.
    shown
        Key of the run that is shown first.
    """
    panels: list[Any] = []
    data: dict[str, Rows] = {}
    if curves:
        panels.append(_draw_calibration())
        data |= {"curves": curves, "diagonal": [{"x": 0, "y": 0}, {"x": 1, "y": 1}]}
    if shares:
        panels.append(_draw_shares([row["run"] for row in shares]))
        data["shares"] = shares
    chart = alt.hconcat(*panels, spacing=60)
    return build_spec(chart.add_params(*run_parameters(names, shown)), data)


def _draw_calibration() -> Any:
    """Draw the share of experts over leverage, beside the diagonal that a chance lies on."""
    unit = alt.Scale(domain=[0, 1], nice=False)
    diagonal = (
        alt.Chart(alt.NamedData("diagonal"))
        .mark_line(strokeDash=[4, 4], color="gray")
        .encode(x=alt.X("x:Q", scale=unit), y=alt.Y("y:Q", scale=unit))
    )
    base = (
        alt.Chart(alt.NamedData("curves"))
        .transform_filter("datum.key === run")
        .encode(
            x=alt.X("leverage:Q", title="Leverage", scale=unit, axis=alt.Axis(tickCount=5)),
            y=alt.Y(
                "truth:Q", title="True share of experts", scale=unit, axis=alt.Axis(tickCount=5)
            ),
        )
    )
    points = base.mark_circle(color=BLUE, opacity=0.9, clip=False).encode(
        size=alt.Size(
            "pairs:Q",
            title="Pairs",
            scale=alt.Scale(type="sqrt", range=[30, 400], domainMin=0),
            legend=None,
        ),
        tooltip=[
            alt.Tooltip("leverage:Q", title="Mean leverage", format=".3f"),
            alt.Tooltip("truth:Q", title="True share of experts", format=".3f"),
            alt.Tooltip("pairs:Q", title="Pairs", format=","),
        ],
    )
    line = base.mark_line(color=BLUE).encode(order="leverage:Q")
    return alt.layer(diagonal, line, points).properties(
        width=SIDE, height=SIDE, title=run_title("Leverage and truth")
    )


def _draw_shares(runs: list[str]) -> Any:
    """Draw the estimated share of every run with its interval, and a tick at the true share."""
    base = alt.Chart(alt.NamedData("shares")).encode(
        y=alt.Y("run:N", sort=runs, title="Run", axis=alt.Axis(labelLimit=160, grid=False)),
        tooltip=[
            alt.Tooltip("run:N", title="Run"),
            alt.Tooltip("share:Q", title="Estimated share", format=".3f"),
            alt.Tooltip("low:Q", title="90 % interval from", format=".3f"),
            alt.Tooltip("high:Q", title="to", format=".3f"),
            alt.Tooltip("truth:Q", title="True share", format=".3f"),
        ],
    )
    axis = alt.X(
        "low:Q",
        title="Share of experts among unlabeled pairs",
        scale=alt.Scale(domain=[0, 1], nice=False),
    )
    interval = base.mark_rule(strokeWidth=5, opacity=0.45, color=BLUE).encode(x=axis, x2="high:Q")
    estimate = base.mark_circle(size=110, opacity=1, color=BLUE).encode(x="share:Q")
    truth = (
        base.transform_filter("datum.truth !== null")
        .mark_tick(thickness=3, size=24, color=ORANGE)
        .encode(x="truth:Q")
    )
    return alt.layer(interval, estimate, truth).properties(
        width=420, height=alt.Step(36), title=title("Estimated expert share, every run")
    )
