"""Requests that were routed before go to their route at once.

FastAPI spends more on finding a route and reading its parameters than a small query takes. Many
clients query the same run with the same parameters again and again: after the first success, the
route and the parameters are cached under what decides about them, which is the method, the path,
the query string and the credentials. The body is not part of it: the route reads it every time.
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

_CACHE_SIZE = 1024
_CREDENTIALS = (b"authorization", b"x-api-key")
_IN_SCOPE = "ssil.route_cache"
"""Key of the scope under which a route finds the cache that its request came through."""
_BoundRoute = Callable[[Request], Awaitable[Response]]
Parameters = ParamSpec("Parameters")


class RouteCache:
    """ASGI middleware that calls a cached route, or else the application.

    Parameters
    ----------
    app
        The application with the router.
    explain
        Turns the library's error into a problem, as the application's own handler does.

    Attributes
    ----------
    hits
        Requests that went to a cached route, since the start.
    """

    def __init__(self, app: FastAPI, explain: Callable[[SsilDataError], Problem]) -> None:
        self.app = app
        self.hits = 0
        self._explain = explain
        self._routes: OrderedDict[Hashable, tuple[_BoundRoute, Any]] = OrderedDict()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request.

        Raises
        ------
        Problem
            If a cached route does; the application's router answers with it itself.
        """
        cached = self._routes.get(_cache_key(scope)) if scope["type"] == "http" else None
        if cached is None:
            scope[_IN_SCOPE] = self
            await self.app(scope, receive, send)
            return
        self.hits += 1
        bound_route, scope["route"] = cached
        scope["app"] = self.app
        try:
            response = await bound_route(Request(scope, receive, send))
        except SsilDataError as error:
            raise self._explain(error) from None
        await response(scope, receive, send)

    def add(self, scope: Scope, bound_route: _BoundRoute) -> None:
        """Cache a route with its parameters; the oldest of too many is dropped.

        Parameters
        ----------
        scope
            Of the request that was answered.
        bound_route
            The route as a function of the request alone.
        """
        self._routes[_cache_key(scope)] = (bound_route, scope["route"])
        while len(self._routes) > _CACHE_SIZE:
            self._routes.popitem(last=False)


def _cache_key(scope: Scope) -> Hashable:
    """Return what decides about route and parameters; credentials enter as a digest only."""
    credentials = [header for header in scope["headers"] if header[0] in _CREDENTIALS]
    digest = hashlib.sha256(repr(credentials).encode()).digest() if credentials else b""
    return scope["method"], scope["path"], scope["query_string"], digest


def cache_route(
    route: Callable[Parameters, Awaitable[Response]],
) -> Callable[Parameters, Awaitable[Response]]:
    """Cache the resolved route and parameters after its first successful response.

    Parameters
    ----------
    route
        An asynchronous route whose parameter `request` is the request, passed by name; all other
        parameters come from the path, the query string and the headers of the cache's key.

    Returns
    -------
    Callable
        The route, which adds itself to the `RouteCache` that its request came through.
    """

    @wraps(route)
    async def route_and_remember(*args: Parameters.args, **values: Parameters.kwargs) -> Response:
        response = await route(*args, **values)
        request: Any = values.pop("request")
        cache: RouteCache | None = request.scope.get(_IN_SCOPE)
        if cache is not None:
            cache.add(request.scope, _bind(route, values))
        return response

    return route_and_remember


def _bind(route: Callable[..., Awaitable[Response]], values: dict[str, Any]) -> _BoundRoute:
    """Return the route with everything but the request filled in."""
    return partial(route, **values)
