"""The edge of the service: what every request passes, whatever it asks.

Request ids, limits of size, time and number, metrics, logs, and a problem for what nobody caught.
"""

from __future__ import annotations

import asyncio
import re
import time

from fastapi import FastAPI
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Receive, Scope, Send

from ssil_service.context import Context
from ssil_service.http.limits import MemoryBudget, RequestLimits, SlowClientError
from ssil_service.logs import log_event
from ssil_service.metrics import Metrics
from ssil_service.problems import Problem, busy, of_fault
from ssil_service.security.hosts import Hosts, in_origin_form
from ssil_service.settings import Settings

_OPEN = ("/healthz", "/readyz", "/v2/health/live", "/v2/health/ready")
_EVENTS = re.compile(r"/v1/jobs/[^/]*/events")


class Counter:
    """How many requests of a kind are in flight, and how many may be."""

    def __init__(self, most: int) -> None:
        self.limit = most
        self.count = 0


class Middleware:
    """ASGI middleware around the whole application; `hosts` are None where keys are set."""

    def __init__(
        self, app: FastAPI, settings: Settings, metrics: Metrics, hosts: Hosts | None
    ) -> None:
        self.app = app
        self._inner: ASGIApp = getattr(app.state, "shortcut", app)
        self.settings = settings
        self.metrics = metrics
        self.held = MemoryBudget(settings.held_bytes)
        self._hosts = hosts
        self._requests = Counter(settings.requests)
        self._streams = Counter(settings.event_streams)
        self._answered: list[tuple[RequestLimits, str, float]] = []
        metrics.watch_middleware(
            requests=lambda: self._requests.count,
            streams=lambda: self._streams.count,
            held=lambda: self.held.bytes,
        )

    @property
    def _context(self) -> Context | None:
        return getattr(self.app.state, "context", None)

    @property
    def _is_closing(self) -> bool:
        here = self._context
        return here is not None and here.closing

    def begin_shutdown(self) -> None:
        """Tell the application that it is about to end."""
        here = self._context
        if here is not None:
            here.begin_shutdown()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, within limits."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        scope = in_origin_form(scope)
        follows = _EVENTS.fullmatch(scope["path"]) is not None
        places = self._streams if follows else self._requests
        places.count += 1
        exchange = RequestLimits(scope, receive, send, self.settings, self.held)
        inner = scope
        if scope["method"] == "HEAD" and not follows:
            inner = {**scope, "method": "GET"}  # the exchange sends the head only
        try:
            if places.count > places.limit and scope["path"] not in _OPEN:
                raise busy(503, "service: expected fewer requests at once, found too many", 1)
            if self._hosts is not None:
                self._hosts.refuse_foreign(scope["method"], exchange.headers)
            exchange.refuse_large()
            await self._inner(inner, exchange.receive, exchange.send)
            if exchange.refused is not None:
                await exchange.answer(exchange.refused)
        except (ClientDisconnect, SlowClientError):
            log_event("gone", request_id=exchange.id)
            await exchange.abort()
        except Problem as problem:
            await exchange.answer(problem)
        except asyncio.CancelledError:
            if not self._is_closing:
                raise
            await self._abandon(exchange)
        except Exception as error:
            log_event("failed", level=40, trace=True, request_id=exchange.id)
            await exchange.answer(of_fault(error))
        finally:
            places.count -= 1
            exchange.close()
            self._record(exchange, getattr(inner.get("route"), "path", "none"))

    async def _abandon(self, exchange: RequestLimits) -> None:
        """End a request for which no time is left."""
        log_event("cut", request_id=exchange.id)
        if exchange.status:
            await exchange.abort()
        else:
            detail = "service: expected time for an answer, found it shutting down"
            doubtful = Problem(503, f"{detail}; the change may be made: look before you repeat it")
            await exchange.answer(doubtful if exchange.may_have_changed else busy(503, detail, 1))

    def _record(self, exchange: RequestLimits, route: str) -> None:
        """Count and log an answer with all others of this round of the loop, which is quicker."""
        if not self._answered:
            asyncio.get_running_loop().call_soon(self._log_answers)
        self._answered.append((exchange, route, time.perf_counter() - exchange.begin))

    def _log_answers(self) -> None:
        answered, self._answered = self._answered, []
        for exchange, route, seconds in answered:
            method, status = exchange.scope["method"], exchange.status or 499
            known = method if route != "none" else "any"
            self.metrics.record_answer(known, route, status, seconds)
            log_event(
                "answered",
                request_id=exchange.id,
                method=method,
                path=exchange.scope["path"],
                status=status,
                milliseconds=round(1000 * seconds, 3),
                received=exchange.received,
            )
