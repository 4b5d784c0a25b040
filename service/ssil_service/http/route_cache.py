"""Questions asked before in the same words go to their route at once.

FastAPI spends more on finding a route and reading its parameters than a small question takes. A
fleet asks the same run with the same parameters again and again: what they came to is remembered
with the route. Only the path, the query and the credentials may decide about it.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Hashable
from functools import partial, wraps
from typing import Any, ParamSpec

from fastapi import FastAPI, Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from ssil_data.errors import SsilDataError
from ssil_service.problems import Problem

_REMEMBERED = 1024
_CREDENTIALS = (b"authorization", b"x-api-key")
_Answer = Callable[[Request], Awaitable[Response]]
Parameters = ParamSpec("Parameters")


class RouteCache:
    """ASGI middleware: the application, or for what is remembered its route."""

    def __init__(self, app: FastAPI, explain: Callable[[SsilDataError], Problem]) -> None:
        self._app = app
        self._explain = explain
        self._known: OrderedDict[Hashable, tuple[_Answer, Any]] = OrderedDict()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer; raises a Problem, which the application would have answered with."""
        known = self._known.get(_cache_key(scope)) if scope["type"] == "http" else None
        if known is None:
            await self._app(scope, receive, send)
            return
        answer, scope["route"] = known
        scope["app"] = self._app
        try:
            response = await answer(Request(scope, receive, send))
        except SsilDataError as error:
            raise self._explain(error) from None
        await response(scope, receive, send)

    def add(self, scope: Scope, answer: _Answer) -> None:
        """Remember what a question came to."""
        self._known[_cache_key(scope)] = (answer, scope["route"])
        while len(self._known) > _REMEMBERED:
            self._known.popitem(last=False)


def _cache_key(scope: Scope) -> Hashable:
    """Return what decides about route and parameters; no credential is kept or compared."""
    given = [header for header in scope["headers"] if header[0] in _CREDENTIALS]
    digest = hashlib.sha256(repr(given).encode()).digest() if given else b""
    return scope["method"], scope["path"], scope["query_string"], digest


def cache_route(
    route: Callable[Parameters, Awaitable[Response]],
) -> Callable[Parameters, Awaitable[Response]]:
    """Let a route be found by the shortcut once it has answered, for all that succeeds."""

    @wraps(route)
    async def first(*args: Parameters.args, **values: Parameters.kwargs) -> Response:
        response = await route(*args, **values)
        request: Any = values.pop("request")
        request.app.state.shortcut.add(request.scope, _query_route(route, values))
        return response

    return first


def _query_route(route: Callable[..., Awaitable[Response]], values: dict[str, Any]) -> _Answer:
    return partial(route, **values)
