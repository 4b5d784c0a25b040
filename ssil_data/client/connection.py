"""One service over HTTP: pooled connections, time-outs, and retries where a retry is safe."""

from __future__ import annotations

import itertools
import random
import time
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import httpx

from ssil_data.client.error_kinds import error_of_status
from ssil_data.errors import DamagedError, InvalidInputError, SsilDataError
from ssil_data.json_kinds import show_short, to_python_number

_BUSY = (429, 503)
_REPEATABLE_METHODS = frozenset({"GET", "HEAD"})
_MOST_ANNOUNCED = 60.0
"""Seconds at most that a service's `Retry-After` is waited for at once."""
_MAYBE_DONE = "; the change may have been made: look before sending it again"


class ServiceError(SsilDataError):
    """The service cannot be reached, refuses the key, stays busy, or failed.

    Examples
    --------
    >>> from ssil_data.client import RetryPolicy
    >>> store = sd.connect("http://127.0.0.1:9", retry=RetryPolicy(total=0))
    >>> try:
    ...     store.names()
    ... except sd.ServiceError as error:
    ...     print("no answer")
    no answer
    """


@dataclass(frozen=True)
class RetryPolicy:
    """How long a busy or unreachable service is tried again.

    Parameters
    ----------
    first
        Seconds before the second attempt, at most; each further wait is twice as long.
    longest
        Seconds of the longest wait, unless the service announces a longer one.
    total
        Seconds after which no attempt begins.

    Raises
    ------
    InvalidInputError
        For what is no number, or a negative one.

    Examples
    --------
    >>> from ssil_data.client import RetryPolicy
    >>> policy = RetryPolicy(first=1.0, longest=8.0)
    >>> 2.0 <= policy.seconds_before(2, announced=0.0) <= 4.0
    True
    """

    first: float = 0.05
    longest: float = 5.0
    total: float = 120.0

    def __post_init__(self) -> None:
        """Validate the seconds; infinitely many mean for ever."""
        for field in fields(RetryPolicy):  # a subclass may have others
            seconds = to_python_number(getattr(self, field.name))
            number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
            if not number or not seconds >= 0:
                raise InvalidInputError(
                    f"{field.name}: expected seconds, 0 or more, found {show_short(seconds)}"
                )
            object.__setattr__(self, field.name, seconds)

    def seconds_before(self, attempt: int, announced: float) -> float:
        """Return how long to wait before another attempt.

        Parameters
        ----------
        attempt
            How many attempts failed before the last one.
        announced
            Seconds that the service asks its clients to wait, 0 for none.

        Returns
        -------
        float
            Seconds: at least those announced, and at random between half the backoff and all of
            it, so that many clients do not come back at the same moment.
        """
        backoff = min(self.longest, self.first * 2.0 ** min(attempt, 32))
        return max(announced, backoff / 2) + random.uniform(0, backoff / 2)


@dataclass(frozen=True)
class _Failure:
    """An attempt that may be repeated, after the seconds that the service announced."""

    error: ServiceError
    announced: float = 0.0


class Connection:
    """Requests to one service; several threads may share it.

    Parameters
    ----------
    client
        The pooled connections.
    retry
        How long a busy or unreachable service is tried again.
    work_timeout
        Seconds that the response to a request that takes work may take.
    """

    def __init__(self, client: httpx.Client, retry: RetryPolicy, work_timeout: float) -> None:
        self.client = client
        self.retry = retry
        self.work_timeout = work_timeout

    def json(self, method: str, path: str, **request: Any) -> Any:
        """Send a request and return the JSON of the response, None for an empty one.

        Parameters
        ----------
        method, path, request
            As `request` takes them.

        Raises
        ------
        SsilDataError
            As `request` does.
        """
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
        """Send a request, again where that is safe, and return the successful response.

        A refusal (429, 503) with `Retry-After` was made before any work, so that any request is
        sent again after the time it names. Other refusals and lost connections are retried only
        for a request that may be repeated.

        Parameters
        ----------
        method, path
            Of the request; the path is relative to the service's URL.
        params
            Of the query; those that are None are left out.
        content, json, headers
            As httpx takes them.
        repeatable
            Whether a second request does no harm; true for GET and HEAD unless given.
        work
            Wait for the response as long as `work_timeout`: the service may go on with what its
            client has given up, so that to give up early tells nothing.

        Returns
        -------
        httpx.Response
            With a status of success.

        Raises
        ------
        SsilDataError
            The error that the library raises for the same mistake; ServiceError for a service that
            cannot be reached, stays busy, refuses the key or failed.
        """
        request = self.client.build_request(
            method,
            path,
            params={key: value for key, value in (params or {}).items() if value is not None},
            content=content,
            json=json,
            headers=headers,
        )
        if work:
            request.extensions["timeout"]["read"] = self.work_timeout
        if repeatable is None:
            repeatable = method in _REPEATABLE_METHODS
        return self._send_with_retries(request, repeatable=repeatable)

    def _send_with_retries(self, request: httpx.Request, *, repeatable: bool) -> httpx.Response:
        deadline = time.monotonic() + self.retry.total
        for attempt in itertools.count():
            found = self._attempt(request, repeatable=repeatable)
            if isinstance(found, httpx.Response):
                return _raise_for_status(found)
            wait = self.retry.seconds_before(attempt, found.announced)
            if time.monotonic() + wait > deadline:
                raise found.error
            time.sleep(wait)
        raise AssertionError("itertools.count never ends")

    def _attempt(self, request: httpx.Request, *, repeatable: bool) -> httpx.Response | _Failure:
        """Send a request once; raises the failure that must not be followed by another attempt."""
        try:
            answer = self.client.send(request)
        except httpx.TransportError as error:
            return self._classify_loss(error, repeatable=repeatable)
        except RuntimeError:
            if not self.client.is_closed:
                raise
            raise ServiceError("service: this store is closed; connect again") from None
        if answer.status_code not in _BUSY:
            return answer
        return _classify_refusal(answer, repeatable=repeatable)

    def _classify_loss(self, error: httpx.TransportError, *, repeatable: bool) -> _Failure:
        """Return a lost connection as a failure to retry, or raise it.

        A request that never left may always be sent again. One whose connection was lost may if it
        is repeatable; after a time-out it is not sent again, as the next would take as long.
        """
        unsent = isinstance(error, httpx.ConnectError | httpx.ConnectTimeout)
        lost = isinstance(error, httpx.NetworkError | httpx.RemoteProtocolError)
        found = str(error) or type(error).__name__
        maybe_done = "" if unsent or repeatable else _MAYBE_DONE
        failure = ServiceError(
            f"service: no answer from {self.client.base_url}: {found}{maybe_done}"
        )
        if unsent or (lost and repeatable):
            return _Failure(failure)
        raise failure from None


def _classify_refusal(answer: httpx.Response, *, repeatable: bool) -> _Failure:
    """Return a busy service's refusal as a failure to retry, or raise it.

    Without `Retry-After` the work may have been done before it was refused.
    """
    if repeatable or "Retry-After" in answer.headers:
        return _Failure(ServiceError(f"service: {_detail(answer)}"), _retry_after(answer))
    raise ServiceError(f"service: {_detail(answer)}{_MAYBE_DONE}")


def _raise_for_status(answer: httpx.Response) -> httpx.Response:
    """Return a successful response; raises the library's error for another."""
    if answer.is_success:
        return answer
    status = answer.status_code
    detail = _detail(answer)
    known = error_of_status(status)
    if known is not None:
        raise known(detail)
    if status in (401, 403):
        raise ServiceError(f"key: {detail}")
    if status == 500 and "damaged" in detail:
        raise DamagedError(detail)
    if status >= 500:
        raise ServiceError(f"service: {detail}")
    raise InvalidInputError(detail)


def _detail(answer: httpx.Response) -> str:
    """Return what a problem says, with all its faults; for another body, its status."""
    try:
        problem = answer.json()
        detail = str(problem.get("detail") or problem["title"])
        faults = [fault["detail"] for fault in problem.get("errors", [])]
    except (ValueError, LookupError, AttributeError, TypeError):
        return f"status {answer.status_code} without a description"
    return "; ".join([detail, *(fault for fault in faults if fault not in detail)])


def _retry_after(answer: httpx.Response) -> float:
    """Return the seconds that a refusal announces; 0 for none, or for a date."""
    try:
        return min(_MOST_ANNOUNCED, float(answer.headers.get("Retry-After", 0)))
    except ValueError:
        return 0.0
