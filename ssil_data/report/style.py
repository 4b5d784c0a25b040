"""What the charts share: the color of leverage, titles, and which run is shown."""

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
    """Return the color scale of leverage; the darkest end is left out, for dark pages.

    Parameters
    ----------
    field
        Field of leverage in [0, 1], with its type: "leverage:Q".
    legend
        Whether to explain the colors above the chart.
    """
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


def title(text: str, *, offset: int = 10) -> alt.TitleParams:
    """Return a chart's title.

    Parameters
    ----------
    text
        The title.
    offset
        Pixels between it and the chart.
    """
    return alt.TitleParams(text, anchor="start", offset=offset)


def run_title(text: str) -> alt.TitleParams:
    """Return a title that ends with the name of the run that is shown.

    Parameters
    ----------
    text
        What comes before the name.
    """
    return alt.TitleParams(alt.ExprRef(f"'{text}: ' + names[run]"), anchor="start", offset=10)


def run_parameters(names: Mapping[str, str], shown: str) -> list[alt.Parameter]:
    """Return the parameters of a chart that shows one run: `run`, its key, and `names`.

    Parameters
    ----------
    names
        Names of the runs by key.
    shown
        Key of the run that is shown first.
    """
    return [alt.param(name="run", value=shown), alt.param(name="names", value=dict(names))]


def build_spec(chart: Any, data: Mapping[str, Rows]) -> Spec:
    """Return a chart with its data as a Vega-Lite specification.

    Parameters
    ----------
    chart
        Altair chart whose data have names.
    data
        Rows by those names; they are not checked one by one, which would take seconds.
    """
    return {**chart.to_dict(), "datasets": dict(data)}
