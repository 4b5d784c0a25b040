"""Parquet files with one number or text per cell, or one list of numbers of a fixed width."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq

from ssil_data.interop.arrow import columns_of
from ssil_data.interop.columns import Columns
from ssil_data.interop.parsing import refuse_unreadable


def read(path: Path) -> Columns:
    """Read the columns of a Parquet file; one of another kind is refused when it is asked for."""
    with refuse_unreadable(path, "Parquet"):
        table = pq.ParquetFile(path, page_checksum_verification=True).read()
        table.validate(full=True)
        return columns_of(path, table, place="at row", first=0)
