"""Errors as RFC 9457 problem details: what was expected and where, never the body itself."""

from __future__ import annotations

import errno
from collections.abc import Iterable, Mapping, Sequence
from http import HTTPStatus
from itertools import islice
from typing import Any

from pydantic import BaseModel
from pydantic_core import ErrorDetails, to_json
from starlette.responses import Response

from ssil_data.errors import (
    ConflictError,
    DamagedError,
    InvalidInputError,
    NotFoundError,
    SsilDataError,
)

PROBLEM = "application/problem+json"
SHOWN = 100
"""Faults that one problem names at most."""
_STATUS: dict[type[SsilDataError], int] = {
    NotFoundError: 404,
    ConflictError: 409,
    InvalidInputError: 422,
    DamagedError: 500,
}


class Fault(BaseModel):
    """One offending place."""

    detail: str
    field: str | None = None
    row: int | None = None
    column: int | None = None


class ProblemDetails(BaseModel):
    """The body of every error (RFC 9457)."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str
    errors: list[Fault] = []
    error: str | None = None
    """The detail once more, in `/v2`, where clients of the inference protocol look for it."""


class Problem(Exception):  # noqa: N818  as RFC 9457 calls it
    """An answer that is an error."""

    def __init__(
        self,
        status: int,
        detail: str,
        *,
        errors: Sequence[Fault] = (),
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(detail)
        self.status = status
        self.detail = detail
        self.errors = errors
        self.headers = dict(headers or {})

    def response(self, path: str = "") -> Response:
        """Return the problem as an answer to a request for `path`."""
        details = ProblemDetails(
            title=HTTPStatus(self.status).phrase,
            status=self.status,
            detail=self.detail,
            errors=list(self.errors[:SHOWN]),
            error=self.detail if path.startswith("/v2") else None,
        )
        body = to_json(details.model_dump(exclude_none=True))
        return Response(body, self.status, media_type=PROBLEM, headers=self.headers)


def busy(status: int, detail: str, seconds: float) -> Problem:
    """Return the problem of a service that has too much to do: ask again after `seconds`.

    `Retry-After` tells that nothing was begun: who asked for a change may repeat it.
    """
    return Problem(status, detail, headers={"Retry-After": str(max(1, round(seconds)))})


def of_library(error: SsilDataError, known: Iterable[str] = ()) -> Problem:
    """Return the library's error as a problem; its message may name a place on the machine."""
    status = next((code for kind, code in _STATUS.items() if isinstance(error, kind)), 500)
    if isinstance(error, DamagedError):
        return Problem(status, "store: expected bytes as written, found them damaged")
    detail = str(error)
    for place in known:
        detail = detail.replace(place, "the store")
    return Problem(status, detail)


def of_fault(error: Exception) -> Problem:
    """Return what nobody expected as a problem: 507 for a full disk, else 500."""
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return Problem(507, "service: expected room on the disk, found none")
    return Problem(500, "service: expected an answer, found a fault of its own")


def of_validation(found: Iterable[ErrorDetails | Mapping[str, Any]], where: str) -> Problem:
    """Return pydantic's errors as one problem that names every field, row and column."""
    errors = [_fault(each["loc"], each["msg"]) for each in islice(found, SHOWN)]
    first = errors[0].detail if errors else "expected another form"
    return Problem(422, f"{where}: {first}", errors=errors)


def _fault(location: Sequence[int | str], message: str) -> Fault:
    parts = list(location)
    numbers = [part for part in parts if isinstance(part, int)]
    parts = [part if isinstance(part, int) else part[:100] for part in parts]
    names = [str(part) for part in parts if not isinstance(part, int)]
    row, column = [*numbers, None, None][:2]
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts)
    detail = f"{place.lstrip('.')}: {message}" if parts else message
    return Fault(detail=detail, field=".".join(names) or None, row=row, column=column)
