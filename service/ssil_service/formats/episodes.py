"""An uploaded table as episodes: named columns as `ssil-data import` takes, or the client's own."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ssil_data.client.wire import matrix_of_rows
from ssil_data.demonstrations import Episode
from ssil_data.errors import InvalidInputError
from ssil_data.interop import Layout, import_episodes
from ssil_data.interop.arrow import columns_of
from ssil_data.interop.parsing import refuse_unreadable

_OWN = (b"state_names", b"action_names")


@dataclass(frozen=True)
class Upload:
    """Episodes, the names of their dimensions, and a card."""

    episodes: Sequence[Episode]
    state_names: Sequence[str]
    action_names: Sequence[str]
    card: str

    @classmethod
    def of(cls, table: pa.Table, *, layout: Mapping[str, Any], file: str) -> Upload:
        """Cut a table into episodes; raises InvalidInputError naming column and row."""
        metadata = table.schema.metadata or {}
        card = metadata.get(b"card", b"").decode("utf-8", "replace")
        if all(key in metadata for key in _OWN):
            states, actions = (_names(key, metadata[key]) for key in _OWN)
            return cls(list(_episodes(table)), states, actions, card)
        given: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in layout.items()
        }
        path = Path(file)
        with refuse_unreadable(path, "table"):
            found = import_episodes(
                columns_of(path, table, place="at row", first=0), Layout(**given)
            )
        return cls(found.episodes, list(found.state_names), list(found.action_names), card)

    def refuse_other_names(self, state_names: list[str], action_names: list[str]) -> None:
        """Raise InvalidInputError unless the dimensions have these names, in this order."""
        for kind, found, expected in (
            ("state", self.state_names, state_names),
            ("action", self.action_names, action_names),
        ):
            if list(found) != expected:
                raise InvalidInputError(f"{kind}: expected the dimensions {expected}, found others")


def _names(key: bytes, value: bytes) -> list[str]:
    try:
        names = json.loads(value)
    except (ValueError, RecursionError):
        names = None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InvalidInputError(
            f"{key.decode()}: expected a JSON list of names, found another value"
        )
    return names


def _episodes(table: pa.Table) -> Iterator[Episode]:
    """Give the episodes of a table as `ssil_data.client.upload` makes it.

    Only state, action and episode have to be there.
    """
    numbers = _column(table, "episode").to_numpy(zero_copy_only=False)
    starts = np.flatnonzero(np.r_[True, numbers[1:] != numbers[:-1]]) if len(numbers) else []
    if len(np.unique(numbers[starts])) != len(starts):
        raise InvalidInputError("episode: expected adjacent rows, found an episode twice")
    states, actions = (_lists(table, name) for name in ("state", "action"))
    known = {n: _column(table, n) for n in (*_PER_PAIR, *_KNOWN) if n in table.column_names}
    for start, stop in zip(starts, [*starts[1:], len(numbers)], strict=True):
        rows = slice(int(start), int(stop))
        values = {name: _value(name, column[rows]) for name, column in known.items()}
        kept = {_PER_PAIR.get(n, n): value for n, value in values.items() if value is not None}
        yield Episode(states[rows], actions[rows], **kept)


def _value(name: str, column: Any) -> Any:
    """Return what a column says of one episode, None for nothing."""
    if name not in _PER_PAIR:
        return _constant(name, column)
    if column.null_count:
        return None
    return column.to_numpy() if name == "reward" else matrix_of_rows(pa.chunked_array([column]))


_PER_PAIR = {"reward": "rewards", "position": "positions"}
_KNOWN = {
    "labeled": pa.bool_(),
    "source": pa.string(),
    "score": pa.float64(),
    "tier": pa.string(),
    "ending": pa.string(),
}


def _column(table: pa.Table, name: str) -> Any:
    if name not in table.column_names:
        raise InvalidInputError(f"{name}: expected a column, found none")
    column = table[name].combine_chunks()
    expected = {"episode": pa.int64(), "reward": pa.float32(), **_KNOWN}.get(name)
    if expected is not None and column.type not in (expected, pa.null()):
        raise InvalidInputError(f"{name}: expected {expected}, found {column.type}")
    if name == "episode" and column.null_count:
        raise InvalidInputError("episode: expected a number in every row, found none")
    return column


def _lists(table: pa.Table, name: str) -> Any:
    column = _column(table, name)
    if not _holds_floats(column.type) or column.null_count or column.flatten().null_count:
        raise InvalidInputError(
            f"{name}: expected lists of float32, found {column.type} or nothing"
        )
    return matrix_of_rows(pa.chunked_array([column]))


def _holds_floats(kind: pa.DataType) -> bool:
    lists = (pa.types.is_list, pa.types.is_fixed_size_list)
    return any(test(kind) for test in lists) and kind.value_type == pa.float32()


def _constant(name: str, column: Any) -> Any:
    values = column.unique()
    if len(values) != 1:
        raise InvalidInputError(f"{name}: expected one value per episode, found {len(values)}")
    return values[0].as_py()
