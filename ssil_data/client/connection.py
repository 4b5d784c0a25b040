"""One service over HTTP: pooled connections, time-outs, and patience where patience may help."""

from __future__ import annotations

import random
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import httpx

from ssil_data.errors import (
    ConflictError,
    DamagedError,
    InvalidInputError,
    NotFoundError,
    SsilDataError,
)

_BUSY = (429, 503)
_FAULTS: dict[int, type[SsilDataError]] = {404: NotFoundError, 409: ConflictError}
_SAFE = frozenset({"GET", "HEAD"})
_MAYBE = "; what was asked may be done: look before asking again"


class ServiceError(SsilDataError):
    """The service cannot be reached, refuses the key, stays busy, or failed."""


@dataclass(frozen=True)
class RetryPolicy:
    """How long to try again: waits double from `first` to `longest`, `total` seconds in all."""

    first: float = 0.05
    longest: float = 5.0
    total: float = 120.0

    def seconds_before(self, attempt: int, asked: float) -> float:
        """Return the seconds before another attempt: at least what was asked, with jitter."""
        backoff = min(self.longest, self.first * 2.0 ** min(attempt, 32))
        return max(asked, backoff / 2) + random.uniform(0, backoff / 2)


class Connection:
    """Requests to one service; may be used from several threads."""

    def __init__(self, client: httpx.Client, patience: RetryPolicy, work_timeout: float) -> None:
        self.client = client
        self.patience = patience
        self.work_timeout = work_timeout

    def json(self, method: str, path: str, **request: Any) -> Any:
        """Return the JSON of an answer, None for an empty one."""
        answer = self.request(method, path, **request)
        return answer.json() if answer.content else None

    def request(
        self,
        method: str,
        path: str,
        *,
        params: Mapping[str, Any] | None = None,
        content: Any = None,
        json: Any = None,
        headers: Mapping[str, str] | None = None,
        repeatable: bool | None = None,
        work: bool = False,
    ) -> httpx.Response:
        """Send a request until it is answered, and return the answer.

        An answer that takes `work` is waited for as long as `work_timeout`: the service may go on
        with what its client has given up, so that to give up early says nothing.

        A busy service (429, 503) is asked again after the time it names: a refusal that names one
        was made before any work. A request that may be repeated is sent again after any refusal
        and when the connection is lost; `repeatable` is true for GET unless given. Raises the
        error that the library raises for the same mistake, or ServiceError.
        """
        repeatable = method in _SAFE if repeatable is None else repeatable
        deadline = time.monotonic() + self.patience.total
        sent = {key: value for key, value in (params or {}).items() if value is not None}
        request = self.client.build_request(
            method, path, params=sent, content=content, json=json, headers=headers
        )
        if work:
            request.extensions["timeout"]["read"] = self.work_timeout
        attempt = 0
        while True:
            asked = 0.0
            try:
                answer = self.client.send(request)
                if answer.status_code not in _BUSY:
                    return _raise_for_status(answer)
                if not (repeatable or "Retry-After" in answer.headers):
                    raise ServiceError(f"service: {_detail(answer)}{_MAYBE}")
                failure = ServiceError(f"service: {_detail(answer)}")
                asked = _retry_after(answer)
            except RuntimeError:
                if not self.client.is_closed:
                    raise
                raise ServiceError(
                    "service: expected an open connection, found it closed"
                ) from None
            except httpx.TransportError as error:
                unsent = isinstance(error, httpx.ConnectError | httpx.ConnectTimeout)
                lost = isinstance(error, httpx.NetworkError | httpx.RemoteProtocolError)
                failure = _unreachable(self.client, error, done=not (unsent or repeatable))
                if not (unsent or (lost and repeatable)):
                    raise failure from None
            wait = self.patience.seconds_before(attempt, asked)
            if time.monotonic() + wait > deadline:
                raise failure
            time.sleep(wait)
            attempt += 1


def _raise_for_status(answer: httpx.Response) -> httpx.Response:
    if answer.is_success:
        return answer
    status, detail = answer.status_code, _detail(answer)
    if status in _FAULTS:
        raise _FAULTS[status](detail)
    if status in (401, 403):
        raise ServiceError(f"key: {detail}")
    if status == 500 and "damaged" in detail:
        raise DamagedError(detail)
    if status >= 500:
        raise ServiceError(f"service: {detail}")
    raise InvalidInputError(detail)


def _detail(answer: httpx.Response) -> str:
    try:
        problem = answer.json()
        detail = str(problem.get("detail") or problem["title"])
        faults = [fault["detail"] for fault in problem.get("errors", [])]
    except (ValueError, LookupError, AttributeError, TypeError):
        return f"expected an answer, found status {answer.status_code}"
    return "; ".join([detail, *(fault for fault in faults if fault not in detail)])


def _retry_after(answer: httpx.Response) -> float:
    try:
        return min(60.0, float(answer.headers.get("Retry-After", 0)))
    except ValueError:
        return 0.0


def _unreachable(client: httpx.Client, error: httpx.TransportError, *, done: bool) -> ServiceError:
    found = str(error) or type(error).__name__
    rest = _MAYBE if done else ""
    return ServiceError(f"service: expected an answer from {client.base_url}, found {found}{rest}")
