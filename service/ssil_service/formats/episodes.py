"""An uploaded table as episodes: named columns as `ssil-data import` takes, or the client's own."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ssil_data.client.upload import CARD_KEY, EPISODE_COLUMNS, NAME_KEYS, PAIR_COLUMNS
from ssil_data.client.wire import matrix_of_rows
from ssil_data.demonstrations import Episode
from ssil_data.errors import InvalidInputError
from ssil_data.interop import Layout, import_episodes
from ssil_data.interop.arrow import decode_table
from ssil_data.interop.parsing import refuse_unreadable
from ssil_data.store.dataset import Dataset
from ssil_data.store.episodes import check_dimension_names


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
        card = metadata.get(CARD_KEY.encode(), b"").decode("utf-8", "replace")
        if all(key.encode() in metadata for key in NAME_KEYS):
            states, actions = (_parse_names(key, metadata[key.encode()]) for key in NAME_KEYS)
            return cls(list(_cut(table)), states, actions, card)
        given: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in layout.items()
        }
        path = Path(file)
        with refuse_unreadable(path, "a table"):
            found = import_episodes(
                decode_table(path, table, place="at row", first=0), Layout(**given)
            )
        return cls(found.episodes, list(found.state_names), list(found.action_names), card)

    def check_dimension_names(self, dataset: Dataset) -> None:
        """Raise InvalidInputError unless the dimensions are the dataset's, in its order."""
        check_dimension_names(
            dataset.name,
            found={"state": self.state_names, "action": self.action_names},
            expected={"state": dataset.state_names, "action": dataset.action_names},
            quote=False,
        )


def _parse_names(key: str, value: bytes) -> list[str]:
    """Return the names in a key of the metadata."""
    try:
        names = json.loads(value)
    except (ValueError, RecursionError):
        names = None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InvalidInputError(f"{key}: this key of the metadata must be a JSON list of names")
    return names


def _cut(table: pa.Table) -> Iterator[Episode]:
    """Yield the episodes of a table as `ssil_data.client.upload` makes it.

    Only the columns state, action and episode have to be there.
    """
    numbers = _column(table, "episode").to_numpy(zero_copy_only=False)
    starts = np.flatnonzero(np.r_[True, numbers[1:] != numbers[:-1]]) if len(numbers) else []
    if len(np.unique(numbers[starts])) != len(starts):
        raise InvalidInputError("episode: the rows of an episode must be adjacent")
    states = _matrix(table, "state")
    actions = _matrix(table, "action")
    optional = (*PAIR_COLUMNS, *EPISODE_COLUMNS)
    known = {name: _column(table, name) for name in optional if name in table.column_names}
    for start, stop in zip(starts, [*starts[1:], len(numbers)], strict=True):
        rows = slice(int(start), int(stop))
        values = {name: _value(name, column[rows]) for name, column in known.items()}
        kept = {PAIR_COLUMNS.get(n, n): value for n, value in values.items() if value is not None}
        yield Episode(states[rows], actions[rows], **kept)


def _value(name: str, column: Any) -> Any:
    """Return the value of a column for one episode, None for nothing."""
    if name not in PAIR_COLUMNS:
        return _constant(name, column)
    if column.null_count:
        return None
    return column.to_numpy() if name == "reward" else matrix_of_rows(pa.chunked_array([column]))


_TYPES = {"episode": pa.int64(), "reward": pa.float32(), **EPISODE_COLUMNS}


def _column(table: pa.Table, name: str) -> Any:
    """Return a column in one piece; raises InvalidInputError for a missing one or another type."""
    if name not in table.column_names:
        raise InvalidInputError(f"{name}: expected a column, found none")
    column = table[name].combine_chunks()
    expected = _TYPES.get(name)
    if expected is not None and column.type not in (expected, pa.null()):
        raise InvalidInputError(f"{name}: expected {expected}, found {column.type}")
    if name == "episode" and column.null_count:
        raise InvalidInputError("episode: every row needs a number")
    return column


def _matrix(table: pa.Table, name: str) -> Any:
    """Return a column of lists as a matrix."""
    column = _column(table, name)
    if not _holds_floats(column.type) or column.null_count or column.flatten().null_count:
        raise InvalidInputError(
            f"{name}: expected lists of float32 without nulls, found {column.type}"
        )
    return matrix_of_rows(pa.chunked_array([column]))


def _holds_floats(kind: pa.DataType) -> bool:
    lists = (pa.types.is_list, pa.types.is_fixed_size_list)
    return any(test(kind) for test in lists) and kind.value_type == pa.float32()


def _constant(name: str, column: Any) -> Any:
    """Return the one value that all rows of an episode have."""
    values = column.unique()
    if len(values) != 1:
        raise InvalidInputError(f"{name}: expected one value per episode, found {len(values)}")
    return values[0].as_py()
