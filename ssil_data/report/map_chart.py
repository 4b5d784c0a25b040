"""The map of leverage as a Vega-Lite specification: where it is low, group by group."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import altair as alt

from ssil_data.report.bins import Grid
from ssil_data.report.style import (
    WIDTH,
    Spec,
    build_spec,
    leverage_color,
    run_parameters,
    run_title,
)

SIDE = 4
"""Pixels of a cell's side."""


def draw_map(grid: Grid, groups: Sequence[str], names: Mapping[str, str], shown: str) -> Spec:
    """Draw a map for each group, colored by leverage under the run that is shown.

    Parameters
    ----------
    grid
        Cells of the map.
    groups
        Names of the groups, in order.
    names
        Names of the runs by key.
    shown
        Key of the run that is shown first.
    """
    width, height = (SIDE * cells for cells in grid.size)
    panels = [
        alt.layer(
            _squares("visited", grid).mark_square(size=SIDE**2, opacity=0.12, color="gray"),
            _squares(f"group{number}", grid, *names, "pairs")
            .transform_calculate(leverage="datum[run] / 100")
            .mark_square(size=(SIDE + 0.6) ** 2, opacity=1)
            .encode(
                color=leverage_color("leverage:Q"),
                tooltip=[
                    alt.Tooltip("x:Q", title="x, m", format=".1f"),
                    alt.Tooltip("y:Q", title="y, m", format=".1f"),
                    alt.Tooltip("pairs:Q", title="Pairs here"),
                    alt.Tooltip("leverage:Q", title="Mean leverage", format=".2f"),
                ],
            ),
        ).properties(width=width, height=height, title=alt.Title(group, anchor="start"))
        for number, group in enumerate(groups)
    ]
    columns = max(1, WIDTH // (width + 60))
    chart = alt.concat(*panels, columns=columns, title=run_title("Leverage on the map"))
    data = {"visited": grid.visited}
    data |= {f"group{number}": [row] for number, row in enumerate(grid.groups)}
    return build_spec(chart.add_params(*run_parameters(names, shown)), data)


def _squares(data: str, grid: Grid, *fields: str) -> alt.Chart:
    """Place the squares of some data at the middle of their cells."""
    half = grid.cell / 2
    x, y = grid.origin
    return (
        alt.Chart(alt.NamedData(data))
        .transform_flatten(["i", "j", *fields])
        .transform_calculate(
            x=f"datum.i * {grid.cell} + {x + half}", y=f"datum.j * {grid.cell} + {y + half}"
        )
        .encode(
            x=_meters("x", x, x + grid.size[0] * grid.cell, SIDE * grid.size[0]),
            y=_meters("y", y, y + grid.size[1] * grid.cell, SIDE * grid.size[1]),
        )
    )


def _meters(axis: str, low: float, high: float, pixels: int) -> Any:
    """Return an axis in meters, x or y, with about 80 pixels between its ticks."""
    channel = alt.X if axis == "x" else alt.Y
    return channel(
        f"{axis}:Q",
        title=f"{axis}, m",
        scale=alt.Scale(domain=[low, high], nice=False, zero=False),
        axis=alt.Axis(tickCount=max(2, pixels // 80), grid=False),
    )
