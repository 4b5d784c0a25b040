"""Cutting the rows of a file into episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Episode
from ssil_data.errors import InvalidInputError
from ssil_data.interop.columns import Columns
from ssil_data.interop.episode_rows import EpisodeRows, format_value
from ssil_data.interop.labeled import find_labeled, is_column
from ssil_data.interop.layout import Layout, fill_layout


@dataclass(frozen=True)
class ImportedEpisodes:
    """Episodes of a file, with the names of their state and action dimensions."""

    episodes: Sequence[Episode]
    state_names: Sequence[str]
    action_names: Sequence[str]


def import_episodes(columns: Columns, layout: Layout) -> ImportedEpisodes:
    """Cut the rows of a file into episodes.

    An episode is a run of adjacent rows with one value of the episode column; without such a
    column the file is one episode. Its score is that of the score column, or else the sum of its
    rewards. A score or tier column that the layout does not name is left out if it varies within
    an episode.

    Parameters
    ----------
    columns
        Columns of the file.
    layout
        Which of them are states, actions and so on; the rest is taken from the usual names.

    Returns
    -------
    ImportedEpisodes
        In the order of the file.

    Raises
    ------
    NotFoundError
        If the layout names a column that the file has not.
    InvalidInputError
        If the rows do not make episodes; it names the file and the row.
    """
    named = layout
    layout = fill_layout(layout, columns)
    for kind in ("state", "action"):
        if not getattr(layout, kind):
            raise InvalidInputError(
                f"{columns.path}: no {kind} column is known; name it with --{kind} COLUMN…, "
                f"the file has {columns.names}"
            )
    columns.check_lengths(_list_columns(columns, layout))
    states, state_names = columns.matrix(layout.state)
    actions, action_names = columns.matrix(layout.action)
    spans = EpisodeRows(columns, layout.episode, len(states))
    for role in ("score", "tier"):
        guessed = getattr(layout, role) if getattr(named, role) is None else None
        if guessed and len(spans.changes(columns.one_per_row(guessed))):
            layout = replace(layout, **{role: None})
    _check_steps(columns, layout.step, spans)
    labeled = find_labeled(columns, layout.labeled, spans)
    rewards = columns.number_per_row(layout.reward) if layout.reward else None
    positions = _read_positions(columns, layout.position)
    scores = tiers = None
    if layout.score:
        scores = spans.one_per_episode(
            layout.score, columns.number_per_row(layout.score, np.float64)
        )
    if layout.tier:
        tiers = spans.one_per_episode(layout.tier, columns.one_per_row(layout.tier))
    episodes = [
        Episode(
            states=states[rows],
            actions=actions[rows],
            labeled=bool(labeled[number]),
            source=f"{columns.path.name}#{spans.values[number]}",
            rewards=None if rewards is None else rewards[rows],
            positions=None if positions is None else positions[rows],
            score=_score_of(number, rows, scores, rewards),
            tier=None if tiers is None else format_value(tiers[number]) or None,
        )
        for number, rows in enumerate(spans.rows)
    ]
    return ImportedEpisodes(episodes, state_names, action_names)


def _list_columns(columns: Columns, layout: Layout) -> list[str]:
    """Return the names of all columns that a layout uses."""
    single = (layout.episode, layout.step, layout.reward, layout.score, layout.tier)
    labeled = layout.labeled if is_column(columns, layout.labeled) else ()
    chosen = (*layout.state, *layout.action, *layout.position, *single, *labeled)
    return [name for name in chosen if name is not None]


def _check_steps(columns: Columns, name: str | None, spans: EpisodeRows) -> None:
    """Refuse steps that do not rise by 1 within an episode."""
    if name is None:
        return
    steps = columns.number_per_row(name, np.float64)
    if columns[name].dtype.kind in "iu":
        steps = columns.one_per_row(name)  # in float64, large integers would run together
    # the difference of integers wraps around, from 255 to 0 in uint8
    skips = spans.within_episodes((np.diff(steps) != 1) | (steps[1:] <= steps[:-1]))
    if len(skips):
        row = int(skips[0])
        before = int(steps[row - 1]) if steps.dtype.kind in "iu" else steps[row - 1]
        raise InvalidInputError(
            f"{columns.path}: expected {name} {format_value(before + 1)} at row {row} of episode "
            f"{spans.episode_at(row)}, found {format_value(steps[row])}"
        )


def _read_positions(columns: Columns, names: Sequence[str]) -> NDArray[np.float32] | None:
    if not names:
        return None
    positions, dimensions = columns.matrix(names)
    if len(dimensions) != 2:
        raise InvalidInputError(
            f"{columns.path}: expected two columns, x and y, as position, found {dimensions}"
        )
    return positions


def _score_of(
    number: int, rows: slice, scores: NDArray[Any] | None, rewards: NDArray[np.float32] | None
) -> float | None:
    """Return the recorded score of an episode, or the sum of its rewards, or None."""
    if scores is not None:
        return float(scores[number])
    return None if rewards is None else float(rewards[rows].sum(dtype=np.float64))
