"""Parquet files with one number per cell, or one list of numbers of a fixed width."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.interop.columns import Columns


def read(path: Path) -> Columns:
    """Read the numeric, text and list columns of a Parquet file; others are left out."""
    try:
        table = pq.ParquetFile(path, page_checksum_verification=True).read()
        table.validate(full=True)
    except (OSError, pa.ArrowException) as error:
        raise InvalidInputError(f"{path}: expected a Parquet file, found {error}") from None
    arrays = {}
    for name in table.column_names:
        array = _array(path, name, table[name].combine_chunks())
        if array is not None:
            arrays[name] = array
    return Columns(path, arrays)


def _array(path: Path, name: str, column: Any) -> NDArray[Any] | None:
    kind = column.type
    is_list = any(
        test(kind)
        for test in (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)
    )
    simple = kind.value_type if is_list else kind
    if not (pa.types.is_primitive(simple) or pa.types.is_string(simple)):
        return None
    if column.null_count:
        row = column.is_null().to_pylist().index(True)
        raise InvalidInputError(
            f"{path}: expected a value in column {name!r}, found none at row {row}"
        )
    if not is_list:
        return column.to_numpy(zero_copy_only=False)
    widths = column.value_lengths().to_numpy()
    odd = np.flatnonzero(widths != widths[:1])
    if len(odd):
        raise InvalidInputError(
            f"{path}: expected width {widths[0]} in column {name!r}, "
            f"found {widths[odd[0]]} at row {odd[0]}"
        )
    width = int(widths[0]) if len(widths) else 0
    return column.flatten().to_numpy(zero_copy_only=False).reshape(len(column), width)
