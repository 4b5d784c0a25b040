"""Parquet files, with a number, a text or a list of numbers of one width in each cell."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq

from ssil_data.interop.arrow import decode_table
from ssil_data.interop.columns import Columns
from ssil_data.interop.parsing import refuse_unreadable


def read(path: Path) -> Columns:
    """Read a Parquet file.

    A column of another kind than numbers, text, times or lists of numbers is left out; using it
    raises an error that says what it is.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    InvalidInputError
        If the file is damaged, or a cell of a column is empty.
    """
    with refuse_unreadable(path, "a Parquet file"):
        table = pq.ParquetFile(path, page_checksum_verification=True).read()
        table.validate(full=True)
        return decode_table(path, table, place="at row", first=0)
