"""Comma-separated files with a line of column names."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
from pyarrow import csv as arrow_csv

from ssil_data.errors import InvalidInputError
from ssil_data.interop.columns import Columns


def read(path: Path) -> Columns:
    """Read a CSV file; a line of another length, or an empty cell, is refused with its number."""
    odd: list[arrow_csv.InvalidRow] = []

    def remember(row: arrow_csv.InvalidRow) -> str:
        odd.append(row)
        return "skip" if len(odd) == 1 else "error"

    try:
        table = arrow_csv.read_csv(
            path,
            read_options=arrow_csv.ReadOptions(use_threads=False),
            parse_options=arrow_csv.ParseOptions(invalid_row_handler=remember),
            convert_options=arrow_csv.ConvertOptions(null_values=[""], strings_can_be_null=True),
        )
    except (pa.ArrowException, UnicodeDecodeError) as error:
        found = _odd(path, odd[0]) if odd else f"{path}: expected a CSV file, found {error}"
        raise InvalidInputError(found) from None
    if odd:
        raise InvalidInputError(_odd(path, odd[0]))
    for name, column in zip(table.column_names, table.columns, strict=True):
        if column.null_count:
            empty = column.is_null().to_pylist().index(True)
            raise InvalidInputError(
                f"{path}: expected a value in column {name!r}, found none in line {empty + 2}"
            )
    return Columns(path, {name: table[name].to_numpy() for name in table.column_names})


def _odd(path: Path, row: arrow_csv.InvalidRow) -> str:
    return (
        f"{path}: expected {row.expected_columns} columns as in the header, "
        f"found {row.actual_columns} in line {row.number}"
    )
