"""One request and its answer, within limits of size and time."""

from __future__ import annotations

import asyncio
import re
import secrets
import time
from collections.abc import Callable

from starlette.types import Message, Receive, Scope, Send

from ssil_data.client.wire import JSON
from ssil_service.problems import Problem, busy
from ssil_service.security.hosts import SAFE
from ssil_service.settings import Settings

ABORT = "abort"
"""Where a connection keeps, in the scope's state, how it is cut."""
_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_SLOWEST = 65_536
"""Bytes a second that a body must bring, and an answer be taken with, beyond the first seconds."""
_IDLE = 10.0
_PART = 65_536
_QUESTIONS = ("/lcor", "/cor", "/score", "/infer")
_JSON = JSON.encode()
_NOSNIFF = (b"x-content-type-options", b"nosniff")
_NO_CACHE = (b"cache-control", b"no-cache")
_CLOSE: dict[str, str] = {"Connection": "close"}


class SlowClientError(TimeoutError):
    """The client takes an answer too slowly."""


class MemoryBudget:
    """Bytes of bodies and of long answers to questions in memory, all requests together."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.bytes = 0

    def reserve(self, size: int, own: int) -> None:
        """Hold more bytes, for one who holds `own`; raises a Problem with 503 for too many.

        Whoever is alone may hold any number: other limits bound what one request takes.
        """
        if self.bytes > own and self.bytes + size > self.most:
            raise busy(503, "service: expected fewer bytes at once, found too many", 1)
        self.bytes += size


class RequestLimits:
    """What passes between a client and the application; to be closed when it is over."""

    def __init__(
        self, scope: Scope, receive: Receive, send: Send, settings: Settings, held: MemoryBudget
    ) -> None:
        self.scope = scope
        self.headers = headers = dict(scope["headers"])
        self.begin = time.perf_counter()
        self.status = 0
        self.received = 0
        self.refused: Problem | None = None
        self._receive, self._send, self._settings = receive, send, settings
        self._held, self._holds = held, 0
        self._sent, self._waited = 0, 0.0
        self._ended = False
        given = headers.get(b"x-request-id", b"").decode("latin-1")
        self.id = given if _ID.fullmatch(given) else secrets.token_hex(8)
        self._length = headers.get(b"content-length", b"")
        method, path = scope["method"], scope["path"]
        posts = method == "POST"
        self.asks = method in SAFE or (posts and path.endswith(_QUESTIONS))
        self._uploads = method == "PUT" or (posts and path.endswith("/episodes"))
        if self._uploads:
            self._most = settings.upload_bytes
        elif headers.get(b"content-type", b"").partition(b";")[0].strip().lower() == _JSON:
            self._most = min(settings.json_bytes, settings.body_bytes)
        else:
            self._most = settings.body_bytes

    @property
    def may_have_changed(self) -> bool:
        """Tell whether the store may be another: by no question, by no upload half received."""
        return not self.asks and (self._ended or not self._uploads)

    def refuse_large(self) -> None:
        """Raise a Problem for a body that says that it is too large."""
        digits = self._length.lstrip(b"0")
        if digits.isdigit() and (len(digits) > 18 or int(digits) > self._most):
            raise self._too_large()

    async def receive(self) -> Message:
        """Receive a part of the body; raises a Problem when it is too large or too slow."""
        if self._ended:
            return await self._receive()  # waits until the client hangs up, as long as that takes
        allowed = self._settings.body_seconds + self.received / _SLOWEST
        left = self.begin + allowed - time.perf_counter()
        try:
            async with asyncio.timeout(max(0.0, min(_IDLE, left))):
                message = await self._receive()
        except TimeoutError:
            raise Problem(
                408, "body: expected it sooner, found the client too slow", headers=_CLOSE
            ) from None
        self._ended = message["type"] != "http.request" or not message.get("more_body", False)
        size = len(message.get("body", b""))
        self.received += size
        if self.received > self._most:
            raise self._too_large()
        if not self._uploads:  # those go to the disk as they arrive
            self._reserve(size)
        return message

    async def send(self, message: Message) -> None:
        """Send a part of the answer; raises SlowError for a client that takes too long."""
        if self.refused is not None:
            return
        if message["type"] == "http.response.start":
            headers = message["headers"]
            names = dict(headers)
            try:
                self._reserve_answer(message["status"], int(names.get(b"content-length", 0)))
            except Problem as problem:  # the application has begun, and may not see it
                self.refused = problem
                return
            self.status = message["status"]
            added = [(b"x-request-id", self.id.encode()), _NOSNIFF]
            if b"cache-control" not in names:
                added.append(_NO_CACHE)
            message = {**message, "headers": [*headers, *added]}
            await self._send_within_limits(message)
            return
        body = message.get("body", b"")
        if self.scope["method"] == "HEAD":
            body = b""
        if len(body) <= _PART:
            await self._send_within_limits({**message, "body": body})
            return
        last = len(body) - 1
        for start in range(0, len(body), _PART):
            more = start + _PART <= last or message.get("more_body", False)
            part = memoryview(body)[start : start + _PART]
            await self._send_within_limits(
                {"type": message["type"], "body": part, "more_body": more}
            )

    async def _send_within_limits(self, message: Message) -> None:
        """Send one message; of all, only the time that the client makes us wait counts.

        That no single part waits for ever is the connection's business.
        """
        begin = time.perf_counter()
        await self._send(message)
        self._sent += len(message.get("body", b""))
        self._waited += time.perf_counter() - begin
        if self._waited > self._settings.send_seconds + self._sent / _SLOWEST:
            raise SlowClientError

    async def answer(self, problem: Problem) -> None:
        """Answer with a problem, if nothing was answered yet."""
        if not self.status:
            self.refused = None
            await problem.response(self.scope["path"])(self.scope, self._receive, self.send)

    async def abort(self) -> None:
        """Drop the connection, and what of the answer still lies in its buffer."""
        abort: Callable[[], None] | None = self.scope.get("state", {}).get(ABORT)
        if abort is not None:
            abort()
            await asyncio.sleep(0)  # the connection learns of it in the loop's next round

    def close(self) -> None:
        """Give up the memory that was held."""
        self._held.bytes -= self._holds
        self._holds = 0

    def _reserve(self, size: int) -> None:
        if size:
            self._held.reserve(size, self._holds)
            self._holds += size

    def _reserve_answer(self, status: int, size: int) -> None:
        """Hold a long answer to a question; no refusal, and not what tells that a change is made.

        Who hears 503 instead would ask for the change again.
        """
        if self.asks and size > _PART and status < 400:
            self._reserve(size)

    def _too_large(self) -> Problem:
        detail = f"body: expected at most {self._most} bytes, found more"
        return Problem(413, detail, headers=_CLOSE)
