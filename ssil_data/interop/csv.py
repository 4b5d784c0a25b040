"""Comma-separated files with a line of column names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
from pyarrow import csv as arrow_csv

from ssil_data.errors import InvalidInputError
from ssil_data.interop.arrow import columns_of
from ssil_data.interop.columns import Columns
from ssil_data.interop.parsing import refuse_unreadable


def read(path: Path) -> Columns:
    """Read a CSV file; a line of another length, or an empty cell, is refused with its number."""
    odd: list[arrow_csv.InvalidRow] = []

    def remember(row: arrow_csv.InvalidRow) -> str:
        odd.append(row)
        return "skip" if len(odd) == 1 else "error"

    with refuse_unreadable(path, "CSV"):
        _check_text(path)
        try:
            table = arrow_csv.read_csv(
                path,
                read_options=arrow_csv.ReadOptions(use_threads=False),
                parse_options=arrow_csv.ParseOptions(invalid_row_handler=remember),
                convert_options=arrow_csv.ConvertOptions(
                    null_values=[""], strings_can_be_null=True
                ),
            )
        except pa.ArrowException:
            if not odd:
                raise
            raise InvalidInputError(_odd(path, odd[0])) from None
        if all(map(_is_number, table.column_names)):
            raise InvalidInputError(
                f"{path}: expected a line of column names, "
                f"found numbers {_shorten(table.column_names)}"
            )
        if odd:
            raise InvalidInputError(_odd(path, odd[0]))
        return columns_of(path, table, place="in line", first=2)


def _check_text(path: Path) -> None:
    # before Arrow sees it: an odd line that is not UTF-8 would be skipped, not remembered
    with path.open("rb") as file:
        for number, line in enumerate(file, start=1):
            try:
                line.decode("utf-8")
            except UnicodeDecodeError as error:
                raise InvalidInputError(
                    f"{path}: expected UTF-8 text, "
                    f"found byte {line[error.start]:#04x} in line {number}"
                ) from None


def _odd(path: Path, row: arrow_csv.InvalidRow) -> str:
    return (
        f"{path}: expected {row.expected_columns} columns as in the header, "
        f"found {row.actual_columns} in line {row.number}"
    )


def _is_number(name: str) -> bool:
    try:
        float(name)
    except ValueError:
        return False
    return True


def _shorten(names: Sequence[str]) -> str:
    return ", ".join(names[:4]) + (", …" if len(names) > 4 else "")
