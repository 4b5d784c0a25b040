"""Which error of the library is which status and which kind on the wire: the table of both sides.

A response that is an error carries a status; a job that failed carries the name of its error's
class as its `kind`. The service writes both, the client reads them back into the same exception.
"""

from __future__ import annotations

from ssil_data.errors import (
    ConflictError,
    DamagedError,
    InvalidInputError,
    NotFoundError,
    SsilDataError,
)

STATUS: dict[type[SsilDataError], int] = {
    NotFoundError: 404,
    ConflictError: 409,
    InvalidInputError: 422,
    DamagedError: 500,
}
"""The HTTP status of each error; another error of the library is a 500 as well."""

CALLER_KINDS: dict[str, type[SsilDataError]] = {
    kind.__name__: kind for kind, status in STATUS.items() if status < 500
}
"""The caller's mistakes by the kind that a failed job names."""


def caller_error(kind: str, detail: str) -> SsilDataError | None:
    """Return the caller's mistake that a failed job names, None for any other failure.

    Parameters
    ----------
    kind
        The name of an error's class.
    detail
        Its message.

    Examples
    --------
    >>> from ssil_data.client.error_kinds import caller_error
    >>> caller_error("NotFoundError", "no such run")
    NotFoundError('no such run')
    >>> caller_error("CrashError", "the process ended") is None
    True
    """
    known = CALLER_KINDS.get(kind)
    return None if known is None else known(detail)


def error_of_status(status: int) -> type[SsilDataError] | None:
    """Return the caller's mistake that a status names exactly, None for any other status.

    Parameters
    ----------
    status
        Of a response.

    Examples
    --------
    >>> from ssil_data.client.error_kinds import error_of_status
    >>> error_of_status(409).__name__
    'ConflictError'
    """
    return next((kind for kind in CALLER_KINDS.values() if STATUS[kind] == status), None)
