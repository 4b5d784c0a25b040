"""Episodes on the map of the racetrack, colored by leverage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import altair as alt
import numpy as np
import vl_convert
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.report.style import leverage_color
from ssil_trainers.envs.racetrack.road import Road

PIXELS_PER_METER = 3.2
MARGIN = 5.0
"""Meters around the road."""

Drive = tuple[NDArray[np.floating[Any]], NDArray[np.floating[Any]]]
"""Positions (n, 2) [m] and leverage (n,) in [0, 1]; 1 is expert-like."""


def draw_drives(road: Road, drives: Mapping[str, Drive], *, columns: int = 2) -> alt.ConcatChart:
    """Draw one map for each drive, under its name; y grows downwards, as highway-env draws it.

    Parameters
    ----------
    road:
        The road.
    drives:
        By name, positions (n, 2) [m] and leverage (n,) in [0, 1]; 1 is expert-like.
    columns:
        Maps in a row.

    Returns
    -------
    altair.ConcatChart
        The chart; `to_png` makes a file of it.

    Raises
    ------
    InvalidInputError
        Where there is not one leverage for each position.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.env import RacetrackEnv
    >>> from ssil_trainers.envs.racetrack.rendering import draw_drives
    >>> drive = (np.array([[50.0, 0.0], [60.0, 2.5]]), np.array([0.2, 1.0]))
    >>> len(draw_drives(RacetrackEnv("oval").road, {"a drive": drive}).concat)
    1
    """
    for name, (positions, leverage) in drives.items():
        if positions.shape != (len(leverage), 2):
            raise InvalidInputError(
                f"{name}: expected positions ({len(leverage)}, 2), found {positions.shape}"
            )
    edge = _edge(road)
    corners = edge.reshape(-1, 2)
    low = corners.min(axis=0) - MARGIN
    high = corners.max(axis=0) + MARGIN
    width, height = (PIXELS_PER_METER * (high - low)).tolist()
    x = alt.X("x:Q", title="x, m", scale=alt.Scale(domain=[low[0], high[0]], nice=False))
    y = alt.Y("y:Q", title="y, m", scale=alt.Scale(domain=[high[1], low[1]], nice=False))
    sides = [dict(zip(("x", "y", "x2", "y2"), side, strict=True)) for side in edge.tolist()]
    road_sides = (
        alt.Chart(alt.Data(values=sides)).mark_rule(color="gray").encode(x, y, x2="x2", y2="y2")
    )
    panels = [
        alt.layer(road_sides, _trail(drive).encode(x, y)).properties(
            width=width, height=height, title=alt.Title(name, anchor="start")
        )
        for name, drive in drives.items()
    ]
    return alt.concat(*panels, columns=columns).configure_axis(grid=False)


def to_png(chart: alt.ConcatChart, *, scale: float = 1.5) -> bytes:
    """Return a chart as the bytes of a PNG file.

    Parameters
    ----------
    chart:
        The chart.
    scale:
        Pixels to one of the chart's.

    Examples
    --------
    >>> from ssil_trainers.envs.racetrack.env import RacetrackEnv
    >>> from ssil_trainers.envs.racetrack.rendering import draw_drives, to_png
    >>> drive = (np.array([[50.0, 0.0], [60.0, 2.5]]), np.array([0.2, 1.0]))
    >>> to_png(draw_drives(RacetrackEnv("oval").road, {"a drive": drive}))[1:4]
    b'PNG'
    """
    return vl_convert.vegalite_to_png(chart.to_json(), scale=scale)


def _trail(drive: Drive) -> alt.Chart:
    """Return a circle for every position, colored by leverage."""
    positions, leverage = drive
    points = [
        {"x": float(x), "y": float(y), "leverage": float(value)}
        for (x, y), value in zip(positions, leverage, strict=True)
    ]
    color = leverage_color("leverage:Q")
    return alt.Chart(alt.Data(values=points)).mark_circle(size=28, opacity=0.9).encode(color=color)


def _edge(road: Road) -> NDArray[np.float64]:
    """Return both edges as short straight sides (m, 4), as `Edges.segments`."""
    sides = [road.edges.segments]
    for x, y, radius, cos, sin, cos_half in road.edges.arcs:
        middle = np.arctan2(sin, cos)
        half = np.arccos(cos_half)
        phase = np.linspace(middle - half, middle + half, 40)
        on = np.stack([x + radius * np.cos(phase), y + radius * np.sin(phase)], axis=1)
        sides.append(np.hstack([on[:-1], on[1:]]))
    return np.concatenate(sides)
