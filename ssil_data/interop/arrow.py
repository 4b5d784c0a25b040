"""Arrow tables as columns: numbers, text, times, and lists of numbers of a fixed width."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import types

from ssil_data.errors import InvalidInputError
from ssil_data.interop.columns import Columns, Unreadable

_TEXT = (types.is_string, types.is_large_string, types.is_string_view)
_CLOCK = (types.is_time,)
_NUMBER = (types.is_boolean, types.is_integer, types.is_floating)
_TIME = (types.is_timestamp, types.is_date, types.is_duration)
_LIST = (types.is_list, types.is_large_list, types.is_fixed_size_list)


def decode_table(path: Path, table: pa.Table, *, place: str, first: int) -> Columns:
    """Decode a table.

    Parameters
    ----------
    path
        File that it comes from, or the name of what it comes from; for messages.
    table
        Its columns may be numbers, text, times, and lists of numbers.
    place
        What a row is called in messages, such as "at row" or "in line".
    first
        Number of the first row in messages.

    Returns
    -------
    Columns
        A column of another kind is not readable there, but the rest is.

    Raises
    ------
    InvalidInputError
        If a cell is empty, or the lists of a column have different lengths.
    """
    named = []
    for name, column in zip(table.column_names, table.columns, strict=True):
        array = _decode(column)
        if not len(array):
            named.append((name, np.empty(0)))
            continue
        if not _is_any(array.type, (*_TEXT, *_CLOCK, *_NUMBER, *_TIME, *_LIST, types.is_null)):
            named.append((name, Unreadable(_describe(array.type))))
            continue
        if array.null_count:
            row = int(np.argmax(array.is_null().to_numpy(zero_copy_only=False)))
            raise InvalidInputError(f"{path}: column {name!r} has no value {place} {row + first}")
        named.append((name, _to_array(path, name, array)))
    return Columns(path, named)


def _decode(column: pa.ChunkedArray) -> Any:
    array: Any = column.combine_chunks()
    return array.dictionary_decode() if types.is_dictionary(array.type) else array


def _is_any(kind: pa.DataType, tests: tuple[Any, ...]) -> bool:
    return any(test(kind) for test in tests)


def _describe(kind: pa.DataType) -> str:
    if types.is_binary(kind) or types.is_large_binary(kind):
        return "bytes that are not UTF-8 text"
    return str(kind)


def _to_array(path: Path, name: str, array: Any) -> NDArray[Any] | Unreadable:
    if _is_any(array.type, (*_TEXT, *_CLOCK)):
        return array.cast(pa.large_string()).to_numpy(zero_copy_only=False)
    if not _is_any(array.type, _LIST):
        return array.to_numpy(zero_copy_only=False)
    cells = array.flatten()
    if not _is_any(cells.type, _NUMBER):
        return Unreadable(str(array.type))
    widths = array.value_lengths().to_numpy(zero_copy_only=False)
    other = np.flatnonzero(widths != widths[0])
    if len(other):
        raise InvalidInputError(
            f"{path}: expected width {widths[0]} in column {name!r}, "
            f"found {widths[other[0]]} at row {other[0]}"
        )
    width = int(widths[0])
    if cells.null_count:
        cell = int(np.argmax(cells.is_null().to_numpy(zero_copy_only=False)))
        raise InvalidInputError(
            f"{path}: column {name!r}[{cell % width}] has no value at row {cell // width}"
        )
    return cells.to_numpy(zero_copy_only=False).reshape(len(array), width)
