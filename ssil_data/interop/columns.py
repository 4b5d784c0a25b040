"""Named columns of any file, and how they become episodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Episode
from ssil_data.errors import InvalidInputError, NotFoundError

_USUAL: Mapping[str, tuple[str, ...]] = {
    "state": ("states", "state"),
    "action": ("actions", "action"),
    "episode": ("episode",),
    "step": ("step",),
    "reward": ("reward", "rewards"),
    "position": ("position", "positions"),
    "score": ("score",),
    "tier": ("tier",),
    "labeled": ("labeled",),
}


@dataclass(frozen=True)
class Layout:
    """Which columns are what. What is not named is taken from columns of the usual names.

    `state` and `action` join several columns in the given order. `labeled` is the name of a
    column of true and false, or values of the episode column: `3`, `0-9`, `all`.
    """

    state: tuple[str, ...] = ()
    action: tuple[str, ...] = ()
    episode: str | None = None
    step: str | None = None
    reward: str | None = None
    position: tuple[str, ...] = ()
    score: str | None = None
    tier: str | None = None
    labeled: tuple[str, ...] = ()


class Columns(Mapping[str, NDArray[Any]]):
    """The columns of one file by name: (n,) or (n, w) arrays of one length."""

    def __init__(self, path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Hold arrays that were read from `path`."""
        self.path = path
        self._arrays = dict(arrays)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column; raises NotFoundError."""
        if name not in self._arrays:
            raise NotFoundError(f"{self.path}: expected one of {list(self)}, found {name!r}")
        return self._arrays[name]

    def __contains__(self, name: object) -> bool:
        """Tell whether the file has a column of that name."""
        return name in self._arrays

    def __iter__(self) -> Iterator[str]:
        """Go through the names in the order of the file."""
        return iter(self._arrays)

    def __len__(self) -> int:
        """Count the columns."""
        return len(self._arrays)

    def numbers(self, name: str) -> NDArray[np.float32]:
        """Return a column as finite float32; raises InvalidInputError naming row and column."""
        column = self[name]
        if column.dtype.kind not in "buif":
            raise InvalidInputError(
                f"{self.path}: expected numbers in column {name!r}, "
                f"found {column.flat[0]!r} at row 0"
            )
        with np.errstate(over="ignore"):
            numbers = column.astype(np.float32)
        bad = np.argwhere(~np.isfinite(numbers))
        if len(bad):
            row, *inner = map(int, bad[0])
            place = f"column {name!r}" + (f"[{inner[0]}]" if inner else "")
            raise InvalidInputError(
                f"{self.path}: expected finite float32 numbers, "
                f"found {column[tuple(bad[0])]} at row {row}, {place}"
            )
        return numbers

    def matrix(self, names: Sequence[str]) -> tuple[NDArray[np.float32], list[str]]:
        """Join columns side by side, (n, w), and name the w dimensions."""
        parts, dimensions = [], []
        for name in names:
            part = self.numbers(name)
            if part.ndim > 2:
                raise InvalidInputError(
                    f"{self.path}: expected one or two dimensions in {name!r}, found {part.shape}"
                )
            dimensions += (
                [name] if part.ndim == 1 else [f"{name}[{i}]" for i in range(part.shape[1])]
            )
            parts.append(part.reshape(len(part), -1))
        lengths = {name: len(part) for name, part in zip(names, parts, strict=True)}
        if len(set(lengths.values())) > 1:
            raise InvalidInputError(f"{self.path}: expected columns of one length, found {lengths}")
        return np.concatenate(parts, axis=1), dimensions

    def complete(self, layout: Layout) -> Layout:
        """Fill what a layout does not name from the columns of the usual names."""
        filled: dict[str, Any] = {}
        for field in fields(layout):
            given = getattr(layout, field.name)
            usual = [name for name in _USUAL[field.name] if name in self][:1]
            if given or not usual:
                filled[field.name] = given
            else:
                filled[field.name] = usual[0] if field.default is None else tuple(usual)
        return Layout(**filled)


@dataclass(frozen=True)
class Imported:
    """Episodes with the names of their dimensions."""

    episodes: Sequence[Episode]
    state_names: Sequence[str]
    action_names: Sequence[str]


def imported(columns: Columns, layout: Layout) -> Imported:
    """Cut the rows of a file into episodes.

    An episode is a run of adjacent rows with one value of the episode column; without such a
    column the file is one episode. Its score is that of the score column, or else its return.
    Raises InvalidInputError naming the file, the row, the expected and the found.
    """
    layout = columns.complete(layout)
    for kind in ("state", "action"):
        if not getattr(layout, kind):
            raise InvalidInputError(
                f"{columns.path}: expected --{kind} COLUMN…, found none; "
                f"the file has {list(columns)}"
            )
    states, state_names = columns.matrix(layout.state)
    actions, action_names = columns.matrix(layout.action)
    if not len(states):
        raise InvalidInputError(f"{columns.path}: expected at least one row, found none")
    cuts = _Cuts(columns, layout.episode, len(states))
    _check_steps(columns, layout.step, cuts)
    labeled = _labeled(columns, layout.labeled, cuts)
    rewards = columns.numbers(layout.reward) if layout.reward else None
    positions = columns.matrix(layout.position)[0] if layout.position else None
    scores = cuts.constant(layout.score) if layout.score else None
    tiers = cuts.constant(layout.tier) if layout.tier else None
    episodes = [
        Episode(
            states=states[rows],
            actions=actions[rows],
            labeled=bool(labeled[number]),
            source=f"{columns.path.name}#{cuts.values[number]}",
            rewards=None if rewards is None else rewards[rows],
            positions=None if positions is None else positions[rows],
            score=_score(number, rows, scores, rewards),
            tier=None if tiers is None else str(tiers[number]) or None,
        )
        for number, rows in enumerate(cuts.rows)
    ]
    return Imported(episodes, state_names, action_names)


class _Cuts:
    """Where the episodes of a file lie: `rows[i]` of the episode whose value is `values[i]`."""

    def __init__(self, columns: Columns, name: str | None, count: int) -> None:
        self.columns = columns
        column = np.zeros(count, int) if name is None else columns[name]
        if len(column) != count or column.ndim != 1:
            raise InvalidInputError(
                f"{columns.path}: expected one episode per row in {name!r}, "
                f"found shape {column.shape} for {count} rows"
            )
        starts = np.flatnonzero(np.r_[True, column[1:] != column[:-1]])
        self.rows = [
            slice(int(a), int(b)) for a, b in zip(starts, [*starts[1:], count], strict=True)
        ]
        self.values = [str(column[start]) for start in starts]
        seen: set[str] = set()
        for value, rows in zip(self.values, self.rows, strict=True):
            if value in seen:
                raise InvalidInputError(
                    f"{columns.path}: expected the rows of an episode to be adjacent, "
                    f"found episode {value} again at row {rows.start}"
                )
            seen.add(value)

    def constant(self, name: str) -> list[Any]:
        """Return a column's one value per episode; raises InvalidInputError if one varies."""
        column = self.columns[name]
        for value, rows in zip(self.values, self.rows, strict=True):
            varies = np.flatnonzero(column[rows] != column[rows.start])
            if len(varies):
                raise InvalidInputError(
                    f"{self.columns.path}: expected one {name} for episode {value}, found another "
                    f"at row {rows.start + int(varies[0])}"
                )
        return [column[rows.start] for rows in self.rows]


def _check_steps(columns: Columns, name: str | None, cuts: _Cuts) -> None:
    if name is None:
        return
    steps = columns.numbers(name)
    for value, rows in zip(cuts.values, cuts.rows, strict=True):
        skips = np.flatnonzero(np.diff(steps[rows]) != 1)
        if len(skips):
            row = rows.start + int(skips[0]) + 1
            raise InvalidInputError(
                f"{columns.path}: expected {name} {steps[row - 1] + 1:g} at row {row} of episode "
                f"{value}, found {steps[row]:g}"
            )


def _score(
    number: int, rows: slice, scores: list[Any] | None, rewards: NDArray[np.float32] | None
) -> float | None:
    if scores is not None:
        return float(scores[number])
    return None if rewards is None else float(rewards[rows].sum(dtype=np.float64))


def _labeled(columns: Columns, chosen: Sequence[str], cuts: _Cuts) -> NDArray[np.bool_]:
    """Tell which episodes are labeled, by a column of the file or by the episodes' values."""
    if len(chosen) == 1 and chosen[0] in columns:
        values = columns.numbers(chosen[0])
        if not np.isin(values, (0, 1)).all():
            raise InvalidInputError(
                f"{columns.path}: expected true and false in {chosen[0]!r}, found other values"
            )
        return np.array(cuts.constant(chosen[0])).astype(bool)
    labeled = np.zeros(len(cuts.values), bool)
    for token in (part for text in chosen for part in text.split(",") if part):
        labeled |= _matching(columns, token, cuts.values)
    return labeled


def _matching(columns: Columns, token: str, values: Sequence[str]) -> NDArray[np.bool_]:
    if token == "all":
        return np.ones(len(values), bool)
    matching = np.array([value == token for value in values])
    low, dash, high = token.partition("-")
    if not matching.any() and dash and low.isdigit() and high.isdigit():
        inside = range(int(low), int(high) + 1)
        matching = np.array([value.isdigit() and int(value) in inside for value in values])
    if not matching.any():
        shown = ", ".join(values[:6]) + (", …" if len(values) > 6 else "")
        raise InvalidInputError(
            f"{columns.path}: expected labeled episodes among [{shown}] or a column of "
            f"{list(columns)[:40]}, found {token!r}"
        )
    return matching
