"""Pages of bulk answers, and answers that the client has already."""

from __future__ import annotations

import hashlib
from typing import Any

import pyarrow as pa
from fastapi import Request
from starlette.responses import Response

from ssil_data.client.wire import JSON
from ssil_service.context import context
from ssil_service.problems import Problem
from ssil_service.routes.accept import table_response
from ssil_service.routes.parameters import PageParameters

_CELLS = {JSON: 2**17}
_CELLS_OF_OTHERS = 2**24


def page_rows(
    request: Request, media: str, total: int, parameters: PageParameters, *, width: int
) -> slice:
    """Return the rows of a page: no more than requested, than may be, than a body should hold."""
    most = context(request).settings.page_rows
    rows = min(parameters.limit or most, most, most_rows(media, width))
    start = min(parameters.offset, total)
    return slice(start, min(start + rows, total))


def most_rows(media: str, width: int) -> int:
    """Return how many rows of so many cells a body should hold."""
    return max(1, _CELLS.get(media, _CELLS_OF_OTHERS) // max(1, width))


async def page_response(
    request: Request, media: str, table: pa.Table, rows: slice, total: int, tag: str, **about: Any
) -> Response:
    """Return a page, whose rows these are, with how many there are and where the next one is."""
    headers = {"X-Total-Count": str(total), "ETag": tag}
    if rows.stop < total:
        following = request.url.include_query_params(offset=rows.stop)
        headers["Link"] = f'<{following.path}?{following.query}>; rel="next"'
    about = {**about, "offset": rows.start, "total": total}
    return await table_response(request, table, media, about=about, headers=headers)


def tag_of(*parts: object) -> str:
    """Return the ETag of what these parts determine."""
    return f'"{hashlib.sha256(repr(parts).encode()).hexdigest()[:24]}"'


def not_modified(request: Request, tag: str) -> Response | None:
    """Return 304 if the client has what the tag names."""
    known = _list_header(request, "if-none-match")
    if known == ["*"] or tag in [each.removeprefix("W/") for each in known]:
        return Response(status_code=304, headers={"ETag": tag})
    return None


def refuse_unmatched(request: Request, tag: str | None) -> None:
    """Raise a Problem with 412 if the change is meant for what has another tag, or for anything.

    None is the tag of what is not there (RFC 9110, 13.1.1).
    """
    known = _list_header(request, "if-match")
    if known and (tag is None or (known != ["*"] and tag not in known)):
        raise Problem(412, "If-Match: expected the newest version's ETag, found another")


def _list_header(request: Request, name: str) -> list[str]:
    """Return what a header lists, on one line or several."""
    lines = request.headers.getlist(name)
    return [each.strip() for each in ",".join(lines).split(",")] if lines else []
