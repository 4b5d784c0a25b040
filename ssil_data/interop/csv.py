"""Comma-separated files whose first line has the names of the columns."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
from pyarrow import csv as arrow_csv

from ssil_data.errors import InvalidInputError
from ssil_data.interop.arrow import decode_table
from ssil_data.interop.columns import Columns
from ssil_data.interop.parsing import refuse_unreadable


def read(path: Path) -> Columns:
    """Read a CSV file.

    Parameters
    ----------
    path
        The file, in UTF-8.

    Raises
    ------
    InvalidInputError
        If the first line has no names, a line has another number of cells, or a cell is empty; it
        names the line.
    """
    invalid: list[arrow_csv.InvalidRow] = []

    def remember(row: arrow_csv.InvalidRow) -> str:
        invalid.append(row)
        return "skip" if len(invalid) == 1 else "error"

    with refuse_unreadable(path, "a CSV file"):
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
            if not invalid:
                raise
            raise InvalidInputError(_describe_invalid_row(path, invalid[0])) from None
        if all(map(_is_number, table.column_names)):
            raise InvalidInputError(
                f"{path}: expected a line of column names, "
                f"found numbers {_shorten(table.column_names)}"
            )
        if invalid:
            raise InvalidInputError(_describe_invalid_row(path, invalid[0]))
        return decode_table(path, table, place="in line", first=2)


def _check_text(path: Path) -> None:
    """Refuse what is not UTF-8, before Arrow does: it would skip such a line without a word."""
    with path.open("rb") as file:
        for number, line in enumerate(file, start=1):
            try:
                line.decode("utf-8")
            except UnicodeDecodeError as error:
                raise InvalidInputError(
                    f"{path}: expected UTF-8 text, "
                    f"found byte {line[error.start]:#04x} in line {number}"
                ) from None


def _describe_invalid_row(path: Path, row: arrow_csv.InvalidRow) -> str:
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
