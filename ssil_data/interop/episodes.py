"""How the rows of a file become episodes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Episode
from ssil_data.errors import InvalidInputError
from ssil_data.interop.columns import Columns, Layout

_INTEGER = re.compile(r"-?[0-9]{1,20}")
_RANGE = re.compile(r"(-?[0-9]{1,20})-(-?[0-9]{1,20})")
_EXACT = 2**53
"""Beyond it, neighbouring integers are one float64."""


@dataclass(frozen=True)
class Imported:
    """Episodes with the names of their dimensions."""

    episodes: Sequence[Episode]
    state_names: Sequence[str]
    action_names: Sequence[str]


def import_episodes(columns: Columns, layout: Layout) -> Imported:
    """Cut the rows of a file into episodes.

    An episode is a run of adjacent rows with one value of the episode column; without such a
    column the file is one episode. Its score is that of the score column, or else its return.
    A score or tier that nobody named is left out if it varies within an episode.
    Raises InvalidInputError naming the file, the row, the expected and the found.
    """
    named, layout = layout, columns.complete(layout)
    for kind in ("state", "action"):
        if not getattr(layout, kind):
            raise InvalidInputError(
                f"{columns.path}: expected --{kind} COLUMN…, found none; "
                f"the file has {columns.names}"
            )
    columns.check_lengths(_used_columns(columns, layout))
    states, state_names = columns.matrix(layout.state)
    actions, action_names = columns.matrix(layout.action)
    cuts = _Cuts(columns, layout.episode, len(states))
    for role in ("score", "tier"):
        name = getattr(layout, role)
        if name and getattr(named, role) is None and len(cuts.changes(columns.one_per_row(name))):
            layout = replace(layout, **{role: None})
    _check_steps(columns, layout.step, cuts)
    labeled = _find_labeled(columns, layout.labeled, cuts)
    rewards = columns.number_per_row(layout.reward) if layout.reward else None
    positions = _positions(columns, layout.position)
    scores = tiers = None
    if layout.score:
        scores = cuts.constant(layout.score, columns.number_per_row(layout.score, np.float64))
    if layout.tier:
        tiers = cuts.constant(layout.tier, columns.one_per_row(layout.tier))
    episodes = [
        Episode(
            states=states[rows],
            actions=actions[rows],
            labeled=bool(labeled[number]),
            source=f"{columns.path.name}#{cuts.values[number]}",
            rewards=None if rewards is None else rewards[rows],
            positions=None if positions is None else positions[rows],
            score=_score(number, rows, scores, rewards),
            tier=None if tiers is None else _format(tiers[number]) or None,
        )
        for number, rows in enumerate(cuts.rows)
    ]
    return Imported(episodes, state_names, action_names)


def _used_columns(columns: Columns, layout: Layout) -> list[str]:
    single = (layout.episode, layout.step, layout.reward, layout.score, layout.tier)
    labeled = layout.labeled if _is_column(columns, layout.labeled) else ()
    chosen = (*layout.state, *layout.action, *layout.position, *single, *labeled)
    return [name for name in chosen if name is not None]


class _Cuts:
    """Where the episodes of a file lie: `rows[i]` of the episode whose value is `values[i]`."""

    def __init__(self, columns: Columns, name: str | None, count: int) -> None:
        self.path = columns.path
        column = np.zeros(count, int) if name is None else columns.one_per_row(name)
        if column.dtype.kind == "f":
            vague = np.flatnonzero(~(np.abs(column) < _EXACT))
            if len(vague):
                raise InvalidInputError(
                    f"{columns.path}: expected integers or text in {name!r}, "
                    f"found {column[vague[0]]} at row {vague[0]}"
                )
        starts = np.flatnonzero(np.r_[True, column[1:] != column[:-1]])
        self._starts = starts
        self.rows = [
            slice(int(a), int(b)) for a, b in zip(starts, [*starts[1:], count], strict=True)
        ]
        self.values = [_format(column[start]) for start in starts]
        seen: set[str] = set()
        for value, rows in zip(self.values, self.rows, strict=True):
            if value in seen:
                raise InvalidInputError(
                    f"{columns.path}: expected the rows of an episode to be adjacent, "
                    f"found episode {value} again at row {rows.start}"
                )
            seen.add(value)

    def episode_at(self, row: int) -> str:
        """Return the value of the episode that a row belongs to."""
        return self.values[int(np.searchsorted(self._starts, row, side="right")) - 1]

    def inside(self, differs: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Return the rows that differ from the one before, (n - 1,), in the same episode."""
        return np.setdiff1d(np.flatnonzero(differs) + 1, self._starts)

    def changes(self, column: NDArray[Any]) -> NDArray[np.intp]:
        """Return the rows where a column (n,) changes within an episode."""
        return self.inside(column[1:] != column[:-1])

    def constant(self, name: str, column: NDArray[Any]) -> NDArray[Any]:
        """Return a column's one value per episode; raises InvalidInputError if one varies."""
        changes = self.changes(column)
        if len(changes):
            row = int(changes[0])
            raise InvalidInputError(
                f"{self.path}: expected one {name} for episode {self.episode_at(row)}, "
                f"found another at row {row}"
            )
        return column[self._starts]


def _format(value: Any) -> str:
    """Write a value as text; 3.0 is the integer 3."""
    if isinstance(value, (float, np.floating)) and float(value).is_integer():
        return str(int(value))
    return str(value)


def _check_steps(columns: Columns, name: str | None, cuts: _Cuts) -> None:
    if name is None:
        return
    steps = columns.number_per_row(name, np.float64)
    if columns[name].dtype.kind in "iu":
        steps = columns.one_per_row(name)  # in float64, large integers would run together
    # the difference of integers wraps around, from 255 to 0 in uint8
    skips = cuts.inside((np.diff(steps) != 1) | (steps[1:] <= steps[:-1]))
    if len(skips):
        row = int(skips[0])
        before = int(steps[row - 1]) if steps.dtype.kind in "iu" else steps[row - 1]
        raise InvalidInputError(
            f"{columns.path}: expected {name} {_format(before + 1)} at row {row} of episode "
            f"{cuts.episode_at(row)}, found {_format(steps[row])}"
        )


def _positions(columns: Columns, names: Sequence[str]) -> NDArray[np.float32] | None:
    if not names:
        return None
    positions, dimensions = columns.matrix(names)
    if len(dimensions) != 2:
        raise InvalidInputError(
            f"{columns.path}: expected two columns, x and y, as position, found {dimensions}"
        )
    return positions


def _score(
    number: int, rows: slice, scores: NDArray[Any] | None, rewards: NDArray[np.float32] | None
) -> float | None:
    if scores is not None:
        return float(scores[number])
    return None if rewards is None else float(rewards[rows].sum(dtype=np.float64))


def _is_column(columns: Columns, chosen: Sequence[str]) -> bool:
    return len(chosen) == 1 and chosen[0] in columns.names


def _find_labeled(columns: Columns, chosen: Sequence[str], cuts: _Cuts) -> NDArray[np.bool_]:
    """Tell which episodes are labeled, by a column of the file or by the episodes' values."""
    if _is_column(columns, chosen):
        values = columns.number_per_row(chosen[0], np.float64)
        other = np.flatnonzero(~np.isin(values, (0, 1)))
        if len(other):
            raise InvalidInputError(
                f"{columns.path}: expected true and false in {chosen[0]!r}, "
                f"found {_format(values[other[0]])} at row {other[0]}"
            )
        return cuts.constant(chosen[0], values).astype(bool)
    tokens = [part for text in chosen for part in text.split(",") if part]
    if chosen and not tokens:
        raise InvalidInputError(
            f"{columns.path}: expected an episode or a column in --labeled, found {chosen[0]!r}"
        )
    labeled = np.zeros(len(cuts.values), bool)
    for token in tokens:
        labeled |= _match(columns, token, cuts.values)
    return labeled


def _match(columns: Columns, token: str, values: Sequence[str]) -> NDArray[np.bool_]:
    if token == "all":
        return np.ones(len(values), bool)
    matching = np.array([value == token for value in values])
    ends = _RANGE.fullmatch(token)
    if not matching.any() and ends and all(end in values for end in ends.groups()):
        low, high = map(int, ends.groups())
        matching = np.array(
            [bool(_INTEGER.fullmatch(value)) and low <= int(value) <= high for value in values]
        )
    if not matching.any():
        shown = ", ".join(values[:6]) + (", …" if len(values) > 6 else "")
        raise InvalidInputError(
            f"{columns.path}: expected labeled episodes among [{shown}] or a column of "
            f"{columns.names[:40]}, found {token!r}"
        )
    return matching
