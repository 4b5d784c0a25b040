"""Pages of long answers, and ETags: answers and versions that the client has already."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import pyarrow as pa
from fastapi import Request
from starlette.responses import Response

from ssil_data.client.wire import JSON
from ssil_service.context import context
from ssil_service.problems import Problem
from ssil_service.routes.accept import table_response
from ssil_service.routes.parameters import PageParameters

_JSON_CELLS = 2**17
_CELLS = 2**24
"""Numbers that one body may have, as JSON and in the other media types."""


def page_rows(
    request: Request, media: str, total: int, parameters: PageParameters, *, width: int
) -> slice:
    """Choose the rows of a page.

    Parameters
    ----------
    request
        The request.
    media
        Media type of the answer.
    total
        Rows of all pages.
    parameters
        The first row and the number of rows that the client wants.
    width
        Numbers in a row.

    Returns
    -------
    slice
        No more rows than the client wants, the settings allow and one body should have.
    """
    most = context(request).settings.page_rows
    rows = min(parameters.limit or most, most, most_rows(media, width))
    start = min(parameters.offset, total)
    return slice(start, min(start + rows, total))


def most_rows(media: str, width: int) -> int:
    """Return how many rows one body should have at most.

    Parameters
    ----------
    media
        Media type of the body.
    width
        Numbers in a row.

    Returns
    -------
    int
        At least 1.
    """
    return max(1, (_JSON_CELLS if media == JSON else _CELLS) // max(1, width))


async def page_response(
    request: Request,
    table: pa.Table,
    media: str,
    *,
    rows: slice,
    total: int,
    tag: str,
    about: Mapping[str, Any],
) -> Response:
    """Answer with one page; headers give the total of rows and the next page.

    Parameters
    ----------
    request
        The request.
    table
        The rows of the page.
    media
        Media type of the answer.
    rows
        Which rows of all pages they are.
    total
        Rows of all pages.
    tag
        ETag of the page.
    about
        Facts about the page.

    Returns
    -------
    Response
        With status 200.

    Raises
    ------
    Problem
        503 if too many long JSON answers wait.
    """
    headers = {"X-Total-Count": str(total), "ETag": tag}
    if rows.stop < total:
        following = request.url.include_query_params(offset=rows.stop)
        headers["Link"] = f'<{following.path}?{following.query}>; rel="next"'
    about = {**about, "offset": rows.start, "total": total}
    return await table_response(request, table, media, about=about, headers=headers)


def tag_of(*parts: object) -> str:
    """Return an ETag.

    Parameters
    ----------
    *parts
        All that the answer depends on.

    Returns
    -------
    str
        Equal for equal parts, in quotes.
    """
    return f'"{hashlib.sha256(repr(parts).encode()).hexdigest()[:24]}"'


def not_modified(request: Request, tag: str) -> Response | None:
    """Answer a client that has the current version already.

    Parameters
    ----------
    request
        Its header `If-None-Match` lists ETags.
    tag
        ETag of the current version.

    Returns
    -------
    Response or None
        With status 304, or None if the answer has to be sent.
    """
    known = _list_header(request, "if-none-match")
    if known == ["*"] or tag in [each.removeprefix("W/") for each in known]:
        return Response(status_code=304, headers={"ETag": tag})
    return None


def refuse_unmatched(request: Request, tag: str | None) -> None:
    """Refuse a change that is meant for another version.

    Parameters
    ----------
    request
        Its header `If-Match` may list ETags of versions (RFC 9110, section 13.1.1).
    tag
        ETag of the current version; None if there is nothing yet, which matches no header.

    Raises
    ------
    Problem
        With status 412.
    """
    known = _list_header(request, "if-match")
    if known and (tag is None or (known != ["*"] and tag not in known)):
        raise Problem(
            412, "If-Match: the newest version has another ETag; read it and decide again"
        )


def _list_header(request: Request, name: str) -> list[str]:
    """Return what a header lists, on one line or several."""
    lines = request.headers.getlist(name)
    return [each.strip() for each in ",".join(lines).split(",")] if lines else []
