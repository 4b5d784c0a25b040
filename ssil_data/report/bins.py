"""Leverage of many pairs as few numbers, for charts: histograms, strips over time, map cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Rows = list[dict[str, Any]]
"""Data of a chart, row by row; the chart flattens arrays. Leverage is in whole percent."""

BINS = 20
CELLS = 20_000
"""Cells that a chart may have, so that the page stays small and quick."""


def to_percent(leverage: NDArray[np.floating]) -> list[int]:
    """Return leverage as whole percent.

    Parameters
    ----------
    leverage
        Leverages (n,) in [0, 1].
    """
    return np.rint(np.asarray(leverage, np.float64) * 100).astype(int).tolist()


def histogram(leverage: NDArray[np.float32]) -> list[float]:
    """Return the share of values in each of `BINS` equal parts of [0, 1], in percent.

    Parameters
    ----------
    leverage
        Leverages (n,) in [0, 1].
    """
    counts, _ = np.histogram(leverage, BINS, (0, 1))
    return (100 * counts / max(1, len(leverage))).round(2).tolist()


@dataclass(frozen=True, eq=False)
class Strips:
    """Episodes as strips of cells, one below the other.

    A cell is `steps` consecutive steps; there are `columns` of them, `column` pixels wide each. The
    whole is `height` pixels high.
    """

    rows: Rows
    labels: Rows
    steps: int
    columns: int
    column: int
    height: int


def lay_out_strips(
    lengths: NDArray[np.int64],
    groups: Sequence[NDArray[np.int64]],
    names: Sequence[str],
    leverage: Mapping[str, NDArray[np.float32]],
    *,
    width: int = 1000,
) -> Strips:
    """Lay out episodes as strips, group below group, and average their leverage over cells.

    Parameters
    ----------
    lengths
        Steps of all episodes, (e,); their pairs follow each other.
    groups
        Indices of the episodes to show of each group, from above.
    names
        Names of the groups.
    leverage
        Leverages of all pairs (n,) of each run.
    width
        Pixels that the longest strip may take, unless its cells are as narrow as one.
    """
    first = np.cumsum(lengths) - lengths
    shown = np.concatenate(groups)
    steps = _bin_steps(lengths[shown])
    thick = int(np.clip(960 // len(shown), 3, 14))
    rows: Rows = []
    labels: Rows = []
    top = 0
    for name, members in zip(names, groups, strict=True):
        if not len(members):
            continue
        labels.append({"name": f"{name} ({len(members):,})", "y": top + len(members) * thick / 2})
        for place, episode in enumerate(members):
            part = slice(first[episode], first[episode] + lengths[episode])
            count = -(-lengths[episode] // steps)
            means = {
                run: to_percent(_means(values[part], steps)) for run, values in leverage.items()
            }
            y = top + place * thick
            rows.append({"i": int(episode), "y": y, "y2": y + thick, "b": [*range(count)], **means})
        top += max(len(members) * thick, 16) + 8
    columns = int(-(-lengths[shown].max() // steps))
    return Strips(rows, labels, steps, columns, max(1, width // columns), top - 8)


def _bin_steps(lengths: NDArray[np.int64]) -> int:
    """Return the least round number of steps that gives few enough cells and columns."""
    for power in range(19):
        for lead in (1, 2, 5):
            steps = lead * 10**power
            cells = np.ceil(lengths / steps)
            if cells.sum() <= CELLS and cells.max() <= 300:
                return steps
    return int(lengths.max())


def _means(values: NDArray[np.float32], steps: int) -> NDArray[np.float64]:
    """Return the means over every `steps` values; the last over what is left."""
    edges = np.arange(0, len(values), steps)
    sums = np.add.reduceat(values, edges, dtype=np.float64)
    return sums / np.diff(np.append(edges, len(values)))


@dataclass(frozen=True, eq=False)
class Grid:
    """A map of square cells.

    cell is the width of one and origin the corner (x, y), both in meters; size is the number of
    cells in x and y. visited are the cells that any group was in, groups those of each group.
    """

    origin: tuple[float, float]
    size: tuple[int, int]
    cell: float
    visited: Rows
    groups: Rows


def build_grid(
    positions: NDArray[np.float32],
    group: NDArray[np.int64],
    count: int,
    leverage: Mapping[str, NDArray[np.float32]],
    *,
    across: int,
) -> Grid:
    """Average leverage over the cells of a map, for each group.

    Parameters
    ----------
    positions
        Where each pair was recorded, (n, 2) in meters.
    group
        Group of each pair, (n,).
    count
        Number of groups.
    leverage
        Leverages (n,) of each run.
    across
        Cells along the longer side of the map.
    """
    low = positions.min(axis=0).astype(np.float64)
    span = float((positions.max(axis=0) - low).max())
    cell = span / across or 1.0
    index = np.floor((positions - low) / cell).astype(np.int64)
    width, height = (int(side) + 1 for side in index.max(axis=0))
    place = index[:, 0] * height + index[:, 1]
    groups = []
    for number in range(count):
        chosen = group == number
        cells, inverse, pairs = np.unique(place[chosen], return_inverse=True, return_counts=True)
        means = {
            run: to_percent(np.bincount(inverse, values[chosen], len(cells)) / pairs)
            for run, values in leverage.items()
        }
        groups.append({**_corners(cells, height), "pairs": pairs.tolist(), **means})
    visited = [_corners(np.unique(place), height)]
    return Grid((float(low[0]), float(low[1])), (width, height), cell, visited, groups)


def _corners(cells: NDArray[np.int64], height: int) -> dict[str, list[int]]:
    return {"i": (cells // height).tolist(), "j": (cells % height).tolist()}
