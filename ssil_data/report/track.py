"""The map as a Vega-Lite spec: where leverage is low, group by group, in metres."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import altair as alt

from ssil_data.report.bins import Grid
from ssil_data.report.look import WIDTH, Spec, build_spec, choice, leverage_color, run_title

SIDE = 4
"""Pixels of a cell's side."""


def track(grid: Grid, groups: Sequence[str], names: Mapping[str, str], shown: str) -> Spec:
    """Draw the map once for each group, coloured by leverage under the run that is shown."""
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
    return build_spec(chart.add_params(*choice(names, shown)), data)


def _squares(data: str, grid: Grid, *fields: str) -> alt.Chart:
    half, (x, y) = grid.cell / 2, grid.origin
    return (
        alt.Chart(alt.NamedData(data))
        .transform_flatten(["i", "j", *fields])
        .transform_calculate(
            x=f"datum.i * {grid.cell} + {x + half}", y=f"datum.j * {grid.cell} + {y + half}"
        )
        .encode(
            x=_metres("x", x, x + grid.size[0] * grid.cell, SIDE * grid.size[0]),
            y=_metres("y", y, y + grid.size[1] * grid.cell, SIDE * grid.size[1]),
        )
    )


def _metres(axis: str, low: float, high: float, pixels: int) -> Any:
    channel = alt.X if axis == "x" else alt.Y
    return channel(
        f"{axis}:Q",
        title=f"{axis}, m",
        scale=alt.Scale(domain=[low, high], nice=False, zero=False),
        axis=alt.Axis(tickCount=max(2, pixels // 80), grid=False),
    )
