"""Which form of an answer a client prefers, and the answer in it: the same numbers in each."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic_core import to_json
from starlette.requests import Request
from starlette.responses import Response

from ssil_data.client.wire import ARROW, JSON, PARQUET, encode, matrix_of_rows
from ssil_service.problems import Problem

BULK = (JSON, ARROW, PARQUET)


def negotiate(request: Request, offered: tuple[str, ...] = BULK) -> str:
    """Return the offered media type that the request prefers; raises a Problem with 406."""
    chosen = _choose(",".join(request.headers.getlist("accept")), offered)
    if chosen is None:
        raise Problem(406, f"Accept: expected one of {', '.join(offered)}, found none of them")
    return chosen


@lru_cache(256)
def _choose(accept: str, offered: tuple[str, ...]) -> str | None:
    """Take the highest quality; between equals the one offered first (RFC 9110, 12.5.1)."""
    ranges = [part for part in map(_range, accept.split(",")) if part is not None]
    if not accept.strip():
        return offered[0]
    scored = [(_quality(media, ranges), -place) for place, media in enumerate(offered)]
    quality, place = max(scored)
    return offered[-place] if quality > 0 else None


def _range(text: str) -> tuple[str, float] | None:
    media, *parameters = (part.strip().lower() for part in text.split(";"))
    quality = 1.0
    for parameter in parameters:
        name, _, value = parameter.partition("=")
        if name.strip() == "q":
            try:
                quality = float(value)
            except ValueError:
                return None
    return (media, quality) if media else None


def _quality(media: str, ranges: list[tuple[str, float]]) -> float:
    """Return the quality of the most specific range that covers a media type."""
    for cover in (media, media.partition("/")[0] + "/*", "*/*"):
        found = [quality for known, quality in ranges if known == cover]
        if found:
            return max(found)
    return 0.0


def table_response(
    table: pa.Table,
    media: str,
    *,
    about: Mapping[str, Any] | None = None,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Return a table as JSON columns, Arrow or Parquet, with `about` it beside its columns."""
    about = dict(about or {})
    if media == JSON:
        columns = {name: _plain(table[name]) for name in table.column_names}
        body: bytes | pa.Buffer = to_json({**about, **columns}, inf_nan_mode="null")
    else:
        table = table.replace_schema_metadata({name: str(value) for name, value in about.items()})
        body = encode(table) if media == ARROW else _parquet(table)
    sent = {"Vary": "Accept", **(headers or {})}
    return Response(memoryview(body), media_type=media, headers=sent)


def _parquet(table: pa.Table) -> pa.Buffer:
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd", use_dictionary=False)
    return sink.getvalue()


def _plain(column: pa.ChunkedArray) -> list[Any]:
    """Return a column as plain Python values; nothing is null that is a number."""
    if pa.types.is_fixed_size_list(column.type) and not column.null_count:
        return matrix_of_rows(column).tolist()
    if pa.types.is_floating(column.type) and not column.null_count:
        return np.asarray(column.to_numpy()).tolist()
    return column.to_pylist()
