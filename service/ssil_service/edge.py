"""The edge of the service: what every request passes, whatever it asks.

Request ids, limits of size, time and number, metrics, logs, and a problem for what nobody caught.
"""

from __future__ import annotations

import asyncio
import re
import secrets
import time
from typing import Any

from fastapi import FastAPI
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import Message, Receive, Scope, Send

from ssil_service.context import Context
from ssil_service.logs import told
from ssil_service.metrics import Metrics
from ssil_service.problems import Problem, busy
from ssil_service.settings import Settings

_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_SLOWEST = 65_536
"""Bytes a second that a body must bring beyond its first seconds."""
_IDLE = 10.0
_OPEN = ("/healthz", "/readyz", "/v2/health/live", "/v2/health/ready")


class Edge:
    """ASGI middleware around the whole application."""

    def __init__(self, app: FastAPI, settings: Settings, metrics: Metrics) -> None:
        self.app = app
        self.settings = settings
        self.metrics = metrics
        self.in_flight = 0
        metrics.count_in_flight(lambda: self.in_flight)

    def leave(self) -> None:
        """Tell the application that it is about to end."""
        here: Context | None = getattr(self.app.state, "context", None)
        if here is not None:
            here.closing = True

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, within limits."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        self.in_flight += 1
        exchange = _Exchange(scope, receive, send, self.settings)
        try:
            if self.in_flight > self.settings.requests and scope["path"] not in _OPEN:
                raise busy(503, "service: expected fewer requests at once, found too many", 1)
            exchange.refuse_large()
            await self.app(scope, exchange.receive, exchange.send)
        except (ClientDisconnect, TimeoutError):
            told("gone", request_id=exchange.id)
        except Problem as problem:
            await exchange.answer(problem)
        except Exception:
            told("failed", level=40, trace=True, request_id=exchange.id)
            await exchange.answer(
                Problem(500, "service: expected an answer, found a fault of its own")
            )
        finally:
            self.in_flight -= 1
            self._record(exchange)

    def _record(self, exchange: _Exchange) -> None:
        seconds = time.perf_counter() - exchange.begin
        route = getattr(exchange.scope.get("route"), "path", "none")
        method = exchange.scope["method"] if route != "none" else "any"
        status = exchange.status or 499
        self.metrics.answered(method, route, status, seconds)
        told(
            "answered",
            request_id=exchange.id,
            method=exchange.scope["method"],
            path=exchange.scope["path"],
            status=status,
            milliseconds=round(1000 * seconds, 3),
            received=exchange.received,
        )


class _Exchange:
    """One request and its answer."""

    def __init__(self, scope: Scope, receive: Receive, send: Send, settings: Settings) -> None:
        self.scope = scope
        self.begin = time.perf_counter()
        self.status = 0
        self.received = 0
        self._receive, self._send, self._settings = receive, send, settings
        self._ended = False
        headers = Headers(scope=scope)
        given = headers.get("x-request-id", "")
        self.id = given if _ID.fullmatch(given) else secrets.token_hex(8)
        self._length = headers.get("content-length", "")
        uploads = scope["method"] == "PUT" or scope["path"].endswith("/episodes")
        self._most = settings.upload_bytes if uploads else settings.body_bytes

    def refuse_large(self) -> None:
        """Raise a Problem for a body that says that it is too large."""
        if self._length.isdigit() and int(self._length) > self._most:
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
        self.received += len(message.get("body", b""))
        if self.received > self._most:
            raise self._too_large()
        return message

    async def send(self, message: Message) -> None:
        """Send a part of the answer; a client that takes none is dropped."""
        if message["type"] == "http.response.start":
            self.status = message["status"]
            headers = MutableHeaders(scope=message)
            headers["X-Request-ID"] = self.id
            headers["X-Content-Type-Options"] = "nosniff"
            headers.setdefault("Cache-Control", "no-cache")
            await self._send(message)  # the head waits for nobody
            return
        async with asyncio.timeout(self._settings.send_seconds):
            await self._send(message)

    async def answer(self, problem: Problem) -> None:
        """Answer with a problem, if nothing was answered yet."""
        if not self.status:
            await problem.response(self.scope["path"])(self.scope, self._receive, self.send)

    def _too_large(self) -> Problem:
        detail = f"body: expected at most {self._most} bytes, found more"
        return Problem(413, detail, headers=_CLOSE)


_CLOSE: dict[str, Any] = {"Connection": "close"}
