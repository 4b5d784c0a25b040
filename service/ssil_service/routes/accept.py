"""Content negotiation (Accept), and tables as answers in the media type that was chosen."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import pyarrow as pa
from starlette.requests import Request
from starlette.responses import Response

from ssil_data.client.wire import ARROW, JSON, PARQUET
from ssil_service.context import context
from ssil_service.formats.tables import write_table
from ssil_service.problems import Problem

BULK = (JSON, ARROW, PARQUET)
"""Media types of tables, JSON where the client has no preference."""


def negotiate(request: Request, offered: tuple[str, ...] = BULK) -> str:
    """Choose the media type of an answer.

    Parameters
    ----------
    request
        Its header `Accept` says what the client prefers.
    offered
        Media types that the route can answer in, the default first.

    Returns
    -------
    str
        The offered one of the highest quality; between equals the one offered first (RFC 9110,
        section 12.5.1).

    Raises
    ------
    Problem
        406 if the client accepts none of them.
    """
    chosen = _choose(",".join(request.headers.getlist("accept")), offered)
    if chosen is None:
        raise Problem(406, f"Accept: only {', '.join(offered)} can be answered")
    return chosen


async def table_response(
    request: Request,
    table: pa.Table,
    media: str,
    *,
    about: Mapping[str, Any] | None = None,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Answer with a table; a long one is written in a thread.

    Parameters
    ----------
    request
        The request to answer.
    table
        What to answer.
    media
        The media type that `negotiate` has chosen.
    about
        Facts about the table, as `write_table` takes them.
    headers
        Further headers.

    Returns
    -------
    Response
        With status 200.

    Raises
    ------
    Problem
        503 if too many long JSON answers wait.
    """
    body = await context(request).convert(
        table.nbytes, lambda: write_table(table, media, about=about), media
    )
    return Response(body, media_type=media, headers={"Vary": "Accept", **(headers or {})})


@lru_cache(256)
def _choose(accept: str, offered: tuple[str, ...]) -> str | None:
    ranges = [part for part in map(_range, accept.split(",")) if part is not None]
    if not accept.strip():
        return offered[0]
    scored = [(_quality(media, ranges), -place) for place, media in enumerate(offered)]
    quality, place = max(scored)
    return offered[-place] if quality > 0 else None


def _range(text: str) -> tuple[str, float] | None:
    """Return a media range of the header and its quality, None for one that cannot be read."""
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
