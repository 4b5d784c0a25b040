"""Errors as RFC 9457 problem details: what is wrong and where, never the body itself."""

from __future__ import annotations

import errno
from collections.abc import Iterable, Mapping, Sequence
from http import HTTPStatus
from itertools import islice
from typing import Any

from pydantic import BaseModel
from pydantic_core import ErrorDetails, to_json
from starlette.responses import Response

from ssil_data.client.error_kinds import STATUS
from ssil_data.errors import DamagedError, SsilDataError

PROBLEM = "application/problem+json"
SHOWN = 100
"""Faults that one problem names at most."""
_NAME_LENGTH = 100
"""Letters of a field's name that are shown at most; clients may make it up."""


class Fault(BaseModel):
    """One offending place of a request."""

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
    """An error as an answer.

    Parameters
    ----------
    status
        HTTP status.
    detail
        What is wrong, and what to do about it; shown to the client.
    errors
        The offending places, of which the first `SHOWN` are shown.
    headers
        Further headers.
    """

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
        """Return the problem as an answer.

        Parameters
        ----------
        path
            Path of the request, as the inference protocol wants the detail under another name.

        Returns
        -------
        Response
            `application/problem+json`.
        """
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
    """Return the problem of a service that has too much to do.

    Parameters
    ----------
    status
        503, or 429 for jobs.
    detail
        What there is too much of.
    seconds
        When to try again. `Retry-After` also promises that nothing was begun: a client may repeat
        even a change.

    Returns
    -------
    Problem
        With the header.
    """
    return Problem(status, detail, headers={"Retry-After": str(max(1, round(seconds)))})


def of_library(error: SsilDataError, known: Iterable[str] = ()) -> Problem:
    """Return the library's error as a problem.

    Parameters
    ----------
    error
        What the library raised.
    known
        Places on this machine, such as the store's folder; its message must not show them.

    Returns
    -------
    Problem
        With the status of the error's kind.
    """
    status = next((code for kind, code in STATUS.items() if isinstance(error, kind)), 500)
    if isinstance(error, DamagedError):
        return Problem(status, "Stored data are damaged; `ssil-data validate` names the files")
    detail = str(error)
    for place in known:
        detail = detail.replace(place, "the store")
    return Problem(status, detail)


def of_fault(error: Exception) -> Problem:
    """Return an exception that the service does not expect as a problem.

    Parameters
    ----------
    error
        The exception; nothing of it is shown.

    Returns
    -------
    Problem
        507 for a full disk, else 500.
    """
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        return Problem(507, "The service's disk is full")
    return Problem(500, "Internal error; the service's log has it under the request id")


def of_validation(errors: Iterable[ErrorDetails | Mapping[str, Any]], where: str) -> Problem:
    """Return pydantic's errors as one problem.

    Parameters
    ----------
    errors
        As pydantic gives them, of which the first `SHOWN` are shown.
    where
        What was validated: "body", "query", "request".

    Returns
    -------
    Problem
        422, naming every field, row and column.
    """
    faults = [_fault(each["loc"], each["msg"]) for each in islice(errors, SHOWN)]
    first = faults[0].detail if faults else "not in the right form"
    return Problem(422, f"{where}: {first}", errors=faults)


def _fault(location: Sequence[int | str], message: str) -> Fault:
    """Return an error's place as field, row and column: the names in it and its first numbers."""
    parts = [part if isinstance(part, int) else part[:_NAME_LENGTH] for part in location]
    numbers = [part for part in parts if isinstance(part, int)]
    names = [part for part in parts if isinstance(part, str)]
    row, column = [*numbers, None, None][:2]
    place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts)
    detail = f"{place.lstrip('.')}: {message}" if parts else message
    return Fault(detail=detail, field=".".join(names) or None, row=row, column=column)
