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


def columns_of(path: Path, table: pa.Table, *, place: str, first: int) -> Columns:
    """Decode a table; an empty cell is refused, named by `place` ("row", "line") from `first`."""
    named = []
    for name, column in zip(table.column_names, table.columns, strict=True):
        array = _decode(column)
        if not len(array):
            named.append((name, np.empty(0)))
            continue
        if not _is(array.type, (*_TEXT, *_CLOCK, *_NUMBER, *_TIME, *_LIST, types.is_null)):
            named.append((name, Unreadable(_kind(array.type))))
            continue
        if array.null_count:
            row = int(np.argmax(array.is_null().to_numpy(zero_copy_only=False)))
            raise InvalidInputError(
                f"{path}: expected a value in column {name!r}, found none {place} {row + first}"
            )
        named.append((name, _array(path, name, array)))
    return Columns(path, named)


def _decode(column: pa.ChunkedArray) -> Any:
    array: Any = column.combine_chunks()
    return array.dictionary_decode() if types.is_dictionary(array.type) else array


def _is(kind: pa.DataType, tests: tuple[Any, ...]) -> bool:
    return any(test(kind) for test in tests)


def _kind(kind: pa.DataType) -> str:
    if types.is_binary(kind) or types.is_large_binary(kind):
        return "bytes that are not UTF-8 text"
    return str(kind)


def _array(path: Path, name: str, array: Any) -> NDArray[Any] | Unreadable:
    if _is(array.type, (*_TEXT, *_CLOCK)):
        return array.cast(pa.large_string()).to_numpy(zero_copy_only=False)
    if not _is(array.type, _LIST):
        return array.to_numpy(zero_copy_only=False)
    cells = array.flatten()
    if not _is(cells.type, _NUMBER):
        return Unreadable(str(array.type))
    widths = array.value_lengths().to_numpy(zero_copy_only=False)
    odd = np.flatnonzero(widths != widths[0])
    if len(odd):
        raise InvalidInputError(
            f"{path}: expected width {widths[0]} in column {name!r}, "
            f"found {widths[odd[0]]} at row {odd[0]}"
        )
    width = int(widths[0])
    if cells.null_count:
        cell = int(np.argmax(cells.is_null().to_numpy(zero_copy_only=False)))
        raise InvalidInputError(
            f"{path}: expected a value in column {name!r}[{cell % width}], "
            f"found none at row {cell // width}"
        )
    return cells.to_numpy(zero_copy_only=False).reshape(len(array), width)
