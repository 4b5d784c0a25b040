"""ASGI middleware that every request passes.

Limits of number, size, time and memory; Host and Origin checks; metrics and logs; and a problem
as the answer to any error that the application did not handle.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable

from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Receive, Scope, Send

from ssil_service.context import Context
from ssil_service.http.limits import RequestLimits, SlowClientError
from ssil_service.http.memory_budget import MemoryBudget
from ssil_service.logs import log_event
from ssil_service.metrics import Metrics
from ssil_service.problems import Problem, busy, of_fault
from ssil_service.security.hosts import Hosts, in_origin_form
from ssil_service.settings import Settings

_SHUTDOWN = "The service is shutting down"
_CLIENT_CLOSED = 499
"""Status under which a request counts whose client disconnected before an answer."""


class Counter:
    """How many requests of a kind are in flight.

    Parameters
    ----------
    limit
        How many may be.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.count = 0


class Middleware:
    """The service as the server calls it: limits around the application.

    Parameters
    ----------
    app
        The application to call for every request, and for the lifespan.
    settings
        Limits.
    metrics
        Where answers are counted and timed.
    hosts
        Names under which the service may be addressed; None, where API keys are set, for any.
    context
        Returns the parts of the running service, or None before the lifespan has begun; also an
        attribute.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        settings: Settings,
        metrics: Metrics,
        hosts: Hosts | None = None,
        context: Callable[[], Context | None] = lambda: None,
    ) -> None:
        self.app = app
        self._settings = settings
        self._metrics = metrics
        self._hosts = hosts
        self.context = context
        self._budget = MemoryBudget(settings.held_bytes)
        self._requests = Counter(settings.requests)
        self._streams = Counter(settings.event_streams)
        self._answered: list[tuple[RequestLimits, str, float]] = []
        metrics.watch_middleware(
            requests=lambda: self._requests.count,
            streams=lambda: self._streams.count,
            held=lambda: self._budget.bytes,
        )

    def begin_shutdown(self) -> None:
        """Start the time of grace: event streams end, and `/readyz` answers 503."""
        context = self.context()
        if context is not None:
            context.begin_shutdown()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request within limits; pass everything else to the application."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        scope = in_origin_form(scope)
        request = RequestLimits(scope, receive, send, settings=self._settings, budget=self._budget)
        counter = self._streams if request.kind.event_stream else self._requests
        inner_scope = _head_as_get(request)
        counter.count += 1
        try:
            await self._answer(request, counter, inner_scope)
        finally:
            counter.count -= 1
            request.close()
            self._record(request, getattr(inner_scope.get("route"), "path", "none"))

    async def _answer(self, request: RequestLimits, counter: Counter, inner_scope: Scope) -> None:
        """Admit a request, call the application, and turn what it raises into an answer."""
        try:
            self._admit(request, counter)
            await self.app(inner_scope, request.receive, request.send)
            if request.refusal is not None:
                await request.answer(request.refusal)
        except (ClientDisconnect, SlowClientError):
            log_event("client disconnected", request_id=request.id)
            await request.abort()
        except Problem as problem:
            await request.answer(problem)
        except asyncio.CancelledError:
            if not self._is_closing:
                raise
            await self._answer_at_shutdown(request)
        except Exception as error:
            log_event("request failed", level=logging.ERROR, trace=True, request_id=request.id)
            await request.answer(of_fault(error))

    def _admit(self, request: RequestLimits, counter: Counter) -> None:
        """Raise a Problem for one request too many, a foreign host, or too long a body."""
        if counter.count > counter.limit and not request.kind.health_check:
            what = "event streams" if request.kind.event_stream else "concurrent requests"
            raise busy(503, f"Too many {what} (limit {counter.limit}); retry after 1 s", 1)
        if self._hosts is not None:
            self._hosts.refuse_foreign(request.scope["method"], request.headers)
        request.refuse_large()

    @property
    def _is_closing(self) -> bool:
        context = self.context()
        return context is not None and context.closing

    async def _answer_at_shutdown(self, request: RequestLimits) -> None:
        """Answer a request that the end of the time of grace has cut off."""
        log_event("request cut off by shutdown", request_id=request.id)
        if request.status:
            await request.abort()
        elif request.may_have_changed:
            detail = f"{_SHUTDOWN}; the change may have been made: check before repeating it"
            await request.answer(Problem(503, detail))
        else:
            await request.answer(busy(503, f"{_SHUTDOWN}; retry after 1 s", 1))

    def _record(self, request: RequestLimits, route: str) -> None:
        """Count and log an answer, together with all others of this round of the event loop.

        Doing so after the round is quicker than one by one, and delays no answer.
        """
        if not self._answered:
            asyncio.get_running_loop().call_soon(self._log_answers)
        self._answered.append((request, route, time.perf_counter() - request.started_at))

    def _log_answers(self) -> None:
        answered = self._answered
        self._answered = []
        for request, route, seconds in answered:
            method = request.scope["method"]
            status = request.status or _CLIENT_CLOSED
            counted_method = method if route != "none" else "any"
            self._metrics.record_answer(counted_method, route, status, seconds)
            log_event(
                "answered",
                request_id=request.id,
                method=method,
                path=request.scope["path"],
                status=status,
                milliseconds=round(1000 * seconds, 3),
                received=request.received,
            )


def _head_as_get(request: RequestLimits) -> Scope:
    """Return the scope for the application: HEAD is a GET of which only the head is sent."""
    if request.scope["method"] == "HEAD" and not request.kind.event_stream:
        return {**request.scope, "method": "GET"}
    return request.scope
