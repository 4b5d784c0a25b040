"""A table as the body of an answer: JSON columns, an Arrow stream or a Parquet file.

All three carry the same numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic_core import to_json

from ssil_data.client.wire import ARROW, JSON, encode, matrix_of_rows


def write_table(
    table: pa.Table, media: str, *, about: Mapping[str, Any] | None = None
) -> memoryview:
    """Write a table.

    Parameters
    ----------
    table
        What to write.
    media
        Media type to write it as: JSON's, Arrow's or Parquet's.
    about
        Facts about the table: further fields of the JSON object, or the metadata of the schema.

    Returns
    -------
    memoryview
        The body.
    """
    about = dict(about or {})
    if media == JSON:
        columns = {name: _to_python(table[name]) for name in table.column_names}
        return memoryview(to_json({**about, **columns}, inf_nan_mode="null"))
    table = table.replace_schema_metadata({name: str(value) for name, value in about.items()})
    return memoryview(encode(table) if media == ARROW else _write_parquet(table))


def _write_parquet(table: pa.Table) -> pa.Buffer:
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd", use_dictionary=False)
    return sink.getvalue()


def _to_python(column: pa.ChunkedArray) -> list[Any]:
    """Return a column as plain Python values; only what is null in Arrow is null in JSON."""
    if pa.types.is_fixed_size_list(column.type) and not column.null_count:
        return matrix_of_rows(column).tolist()
    if pa.types.is_floating(column.type) and not column.null_count:
        return np.asarray(column.to_numpy()).tolist()
    return column.to_pylist()
