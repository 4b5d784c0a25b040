"""What the charts share: the colour of leverage, titles, the choice of a run, data by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import altair as alt

from ssil_data.report.bins import Rows

Spec = dict[str, Any]
"""A Vega-Lite specification as JSON."""

WIDTH = 1120
"""Pixels that a chart may take beside its axis."""


def leverage_color(field: str, *, legend: bool = True) -> alt.Color:
    """Colour a field of leverage in [0, 1]; the darkest end is left out, for dark pages."""
    scale = alt.Scale(domain=[0, 1], scheme=alt.SchemeParams("viridis", extent=[0.15, 1]))
    if not legend:
        return alt.Color(field, scale=scale, legend=None)
    bar = alt.Legend(
        title="Leverage: 0 = unlike the experts, 1 = expert-like",
        orient="top",
        gradientLength=280,
        titleLimit=400,
        values=[0, 0.25, 0.5, 0.75, 1],
        format=".2f",
    )
    return alt.Color(field, scale=scale, legend=bar)


def title(text: str) -> alt.TitleParams:
    """Return a chart's title."""
    return alt.TitleParams(text, anchor="start", offset=10)


def run_title(text: str) -> alt.TitleParams:
    """Return a title that ends with the name of the run that is shown."""
    return alt.TitleParams(alt.ExprRef(f"'{text}: ' + names[run]"), anchor="start", offset=10)


def choice(names: Mapping[str, str], shown: str) -> list[alt.Parameter]:
    """Return the parameters of a chart of one run: `run`, a key, and `names` by keys."""
    return [alt.param(name="run", value=shown), alt.param(name="names", value=dict(names))]


def build_spec(chart: Any, data: Mapping[str, Rows]) -> Spec:
    """Return the spec of a chart with its data, which were not checked row by row."""
    return {**chart.to_dict(), "datasets": dict(data)}
