"""One request and its answer, within limits of size, time and memory."""

from __future__ import annotations

import asyncio
import re
import secrets
import time
from collections.abc import Callable

from starlette.types import Message, Receive, Scope, Send

from ssil_data.client.wire import JSON
from ssil_service.http.memory_budget import MemoryBudget
from ssil_service.http.route_kinds import RouteKind
from ssil_service.problems import Problem
from ssil_service.settings import Settings

ABORT = "abort"
"""Key of the scope's state under which the protocol leaves a function that cuts the connection."""
SLOWEST_BYTES_PER_SECOND = 65_536
"""Least pace of a body, and of a client that reads an answer, after the first seconds."""
_RECEIVE_SECONDS = 10.0
"""Most time for one part of a body; a client that sends nothing for so long is too slow."""
_CHUNK_BYTES = 65_536
_REQUEST_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_JSON = JSON.encode()
_NOSNIFF = (b"x-content-type-options", b"nosniff")
_NO_CACHE = (b"cache-control", b"no-cache")
_CLOSE: dict[str, str] = {"Connection": "close"}


class SlowClientError(TimeoutError):
    """The client reads an answer too slowly."""


class RequestLimits:
    """Stands between a client and the application for one request; close it at the end.

    The application is called with `receive` and `send` of this object instead of the server's:
    they count bytes and time, cut long answers into chunks, and add headers to every answer.

    Parameters
    ----------
    scope, receive, send
        The request as ASGI gives it.
    settings
        Limits of size and time.
    budget
        Memory that all requests share.

    Attributes
    ----------
    kind
        What the request is for, see `RouteKind`.
    id
        The client's `X-Request-ID`, or a random one.
    status
        Status of the answer, 0 until it begins.
    received
        Bytes of the body so far.
    refusal
        The problem to answer with instead of what the application sends, if its answer does not
        fit into memory.
    """

    def __init__(
        self,
        scope: Scope,
        receive: Receive,
        send: Send,
        *,
        settings: Settings,
        budget: MemoryBudget,
    ) -> None:
        self.started_at = time.perf_counter()
        self.scope = scope
        self.headers: dict[bytes, bytes] = dict(scope["headers"])
        self.kind = RouteKind.of(scope["method"], scope["path"])
        self.id = _request_id(self.headers)
        self.status = 0
        self.received = 0
        self.refusal: Problem | None = None
        self._receive = receive
        self._send = send
        self._settings = settings
        self._body_limit = _body_limit(self.kind, self.headers, settings)
        self._body_ended = False
        self._budget = budget
        self._reserved_bytes = 0
        self._sent_bytes = 0
        self._send_seconds = 0.0

    @property
    def may_have_changed(self) -> bool:
        """Whether the store may have changed: not by a query, nor by an upload half received."""
        return not self.kind.read_only and (self._body_ended or not self.kind.upload)

    def refuse_large(self) -> None:
        """Check the length that the client announces.

        Raises
        ------
        Problem
            413 if the body is longer than its limit.
        """
        digits = self.headers.get(b"content-length", b"").lstrip(b"0")
        if digits.isdigit() and (len(digits) > 18 or int(digits) > self._body_limit):
            raise self._too_large()

    async def receive(self) -> Message:
        """Receive a part of the body.

        Returns
        -------
        Message
            The ASGI message.

        Raises
        ------
        Problem
            408 for a body that arrives too slowly, 413 for one that is too long, 503 if there is
            no memory for it now.
        """
        if self._body_ended:
            return await self._receive()  # returns when the client disconnects
        allowed = self._settings.body_seconds + self.received / SLOWEST_BYTES_PER_SECOND
        left = self.started_at + allowed - time.perf_counter()
        try:
            async with asyncio.timeout(max(0.0, min(_RECEIVE_SECONDS, left))):
                message = await self._receive()
        except TimeoutError:
            raise self._too_slow() from None
        self._body_ended = message["type"] != "http.request" or not message.get("more_body", False)
        size = len(message.get("body", b""))
        self.received += size
        if self.received > self._body_limit:
            raise self._too_large()
        if not self.kind.upload:  # uploads go to the disk as they arrive
            self._reserve(size)
        return message

    async def send(self, message: Message) -> None:
        """Send a part of the answer.

        Parameters
        ----------
        message
            The ASGI message of the application.

        Raises
        ------
        SlowClientError
            If the client reads the answer too slowly.
        """
        if self.refusal is not None:
            return
        if message["type"] == "http.response.start":
            await self._send_head(message)
        else:
            await self._send_body(message)

    async def _send_head(self, message: Message) -> None:
        """Send status and headers, or note a refusal if a long answer has no room in memory."""
        headers = message["headers"]
        names = dict(headers)
        try:
            self._reserve_answer(message["status"], int(names.get(b"content-length", 0)))
        except Problem as problem:  # not raised: the application would treat it as its own error
            self.refusal = problem
            return
        self.status = message["status"]
        added = [(b"x-request-id", self.id.encode()), _NOSNIFF]
        if b"cache-control" not in names:
            added.append(_NO_CACHE)
        await self._send_and_time({**message, "headers": [*headers, *added]})

    async def _send_body(self, message: Message) -> None:
        """Send a body in chunks, so that the pace of a slow client can be measured."""
        body = message.get("body", b"")
        if self.scope["method"] == "HEAD":
            body = b""
        if len(body) <= _CHUNK_BYTES:
            await self._send_and_time({**message, "body": body})
            return
        for start in range(0, len(body), _CHUNK_BYTES):
            chunk = memoryview(body)[start : start + _CHUNK_BYTES]
            is_last_chunk = start + _CHUNK_BYTES >= len(body)
            more_body = not is_last_chunk or message.get("more_body", False)
            await self._send_and_time(
                {"type": message["type"], "body": chunk, "more_body": more_body}
            )

    async def _send_and_time(self, message: Message) -> None:
        """Send one message and add the time that the client made it wait.

        A client that reads nothing at all is cut off by the connection's own time-out.
        """
        started_at = time.perf_counter()
        await self._send(message)
        self._sent_bytes += len(message.get("body", b""))
        self._send_seconds += time.perf_counter() - started_at
        allowed = self._settings.send_seconds + self._sent_bytes / SLOWEST_BYTES_PER_SECOND
        if self._send_seconds > allowed:
            raise SlowClientError

    async def answer(self, problem: Problem) -> None:
        """Answer with a problem, unless an answer has begun.

        Parameters
        ----------
        problem
            Becomes the whole answer.
        """
        if not self.status:
            self.refusal = None
            await problem.response(self.scope["path"])(self.scope, self._receive, self.send)

    async def abort(self) -> None:
        """Cut the connection, and drop what of the answer is still in its buffer."""
        abort: Callable[[], None] | None = self.scope.get("state", {}).get(ABORT)
        if abort is not None:
            abort()
            await asyncio.sleep(0)  # the connection is closed in the loop's next round

    def close(self) -> None:
        """Give back the memory that the request reserved."""
        self._budget.release(self._reserved_bytes)
        self._reserved_bytes = 0

    def _reserve(self, size: int) -> None:
        if size:
            self._budget.reserve(size, reserved=self._reserved_bytes)
            self._reserved_bytes += size

    def _reserve_answer(self, status: int, size: int) -> None:
        """Reserve memory for a long answer to a read-only request.

        A committed change is always acknowledged, even under memory pressure: after a 503 the
        client would repeat it.
        """
        if self.kind.read_only and size > _CHUNK_BYTES and status < 400:
            self._reserve(size)

    def _too_large(self) -> Problem:
        detail = f"body: longer than the limit of {self._body_limit} bytes"
        return Problem(413, detail, headers=_CLOSE)

    def _too_slow(self) -> Problem:
        detail = (
            f"body: arrived too slowly (allowed: {self._settings.body_seconds:g} s, "
            f"1 s more for every {SLOWEST_BYTES_PER_SECOND} bytes, and at most "
            f"{_RECEIVE_SECONDS:g} s between two parts)"
        )
        return Problem(408, detail, headers=_CLOSE)


def _request_id(headers: dict[bytes, bytes]) -> str:
    """Return the client's request id if it is a plain one, else a random one."""
    given = headers.get(b"x-request-id", b"").decode("latin-1")
    return given if _REQUEST_ID.fullmatch(given) else secrets.token_hex(8)


def _body_limit(kind: RouteKind, headers: dict[bytes, bytes], settings: Settings) -> int:
    """Return how many bytes the body may have; JSON is limited further, as it grows when read."""
    if kind.upload:
        return settings.upload_bytes
    media = headers.get(b"content-type", b"").partition(b";")[0].strip().lower()
    if media == _JSON:
        return min(settings.json_bytes, settings.body_bytes)
    return settings.body_bytes
