"""The application: its routes, every error as a problem, and the parts that it opens at the start.

A request passes `Middleware`, `RouteCache`, FastAPI's router and a route, which finds the parts in
its `Context`.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from importlib.metadata import version
from typing import Any

from fastapi import APIRouter, Depends, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response

from ssil_data.errors import SsilDataError
from ssil_data.store import Store
from ssil_service.context import Context
from ssil_service.http.middleware import Middleware
from ssil_service.http.openapi import build_document, find_methods, problems
from ssil_service.http.route_cache import RouteCache
from ssil_service.jobs.queue import JobQueue
from ssil_service.metrics import Metrics
from ssil_service.problems import Problem, of_fault, of_library
from ssil_service.queries.admission import BoundedExecutor
from ssil_service.queries.catalog import Catalog
from ssil_service.routes import (
    datasets,
    documentation,
    health,
    inference,
    jobs,
    queries,
    runs,
    uploads,
)
from ssil_service.routes.parameters import of_invalid_request
from ssil_service.security.authentication import Keys, require_key
from ssil_service.security.hosts import Hosts
from ssil_service.settings import Settings
from ssil_service.workers.decoding import Decoder
from ssil_service.workers.lease import ServerLease
from ssil_service.workers.pool import Pool

_WORKER_BYTES = 2**29
"""Memory that a worker takes before it has decoded anything, and some to spare."""
_Lifespan = Callable[[FastAPI], AbstractAsyncContextManager[None]]
_Handler = Callable[[Request, Any], Awaitable[Response]]


def create_app(settings: Settings, *, hosts: Iterable[str] = ()) -> Middleware:
    """Make the service as an ASGI application; it opens the store when its lifespan begins.

    Parameters
    ----------
    settings
        Where the store is, and all limits.
    hosts
        Without keys, names under which the service may be addressed beside those of this machine.

    Returns
    -------
    Middleware
        The application, for any ASGI server. `context()` gives its parts while it runs.

    Raises
    ------
    InvalidInputError
        For keys that are too short or not in the right form.
    """
    keys = Keys.of(settings)
    metrics = Metrics()
    app = FastAPI(
        title="ssil-data",
        version=version("ssil-data"),
        summary="Leverage and LCoR of demonstrations",
        lifespan=_lifespan(settings, metrics),
        redirect_slashes=False,
        docs_url=None,
        redoc_url=None,
    )
    app.openapi = lambda: build_document(app, settings, local_only=not keys)
    _include_routes(app, keys)
    for kind, handler in _handlers(settings).items():
        app.add_exception_handler(kind, handler)
    return Middleware(
        RouteCache(app, lambda error: _explain_library_error(settings, error)),
        settings=settings,
        metrics=metrics,
        hosts=None if keys else Hosts.of(settings, hosts),
        context=lambda: getattr(app.state, "context", None),
    )


def open_context(settings: Settings, metrics: Metrics) -> Context:
    """Open the parts of the service.

    Parameters
    ----------
    settings
        Where the store is, and all limits.
    metrics
        Where the parts show what they count.

    Returns
    -------
    Context
        The parts, to be closed. This server has its folder beside those of the store's others,
        what killed servers left behind is cleared up, and their jobs are taken over.

    Raises
    ------
    InvalidInputError
        If there is no folder for the service's own state.
    OSError
        If that folder cannot be written.
    """
    lease = ServerLease(settings.state_folder)
    catalog = Catalog(Store(settings.store), settings.cache_bytes)
    catalog.sweep()
    fit_workers = Pool(lease.lock, settings.job_bytes, settings.job_seconds, keep=1)
    jobs = JobQueue(
        settings.store, lease, fit_workers, running=settings.jobs, waiting=settings.job_queue
    )
    jobs.start()
    context = Context(
        settings=settings,
        metrics=metrics,
        lease=lease,
        catalog=catalog,
        executor=BoundedExecutor(settings.computing, settings.waiting),
        json_executor=BoundedExecutor(1, settings.waiting),
        decoder=_open_decoder(settings, lease),
        jobs=jobs,
        store_folder=catalog.store_folder,
    )
    _watch(context)
    return context


def _open_decoder(settings: Settings, lease: ServerLease) -> Decoder:
    memory = settings.decoded_bytes + _WORKER_BYTES
    return Decoder(
        lease,
        Pool(lease.lock, memory, settings.decode_seconds, keep=1),
        query_rows=settings.query_rows,
        upload_rows=settings.decoded_bytes // 8,  # a row has 8 bytes at the very least
    )


def _watch(context: Context) -> None:
    """Let the metrics read what the parts count."""
    cache = context.catalog.cache
    context.metrics.watch_executors(
        admitted=lambda: context.executor.admitted,
        refused=lambda: context.executor.refused,
        json_refused=lambda: context.json_executor.refused,
    )
    context.metrics.watch_cache(
        size=lambda: cache.bytes,
        entries=lambda: len(cache),
        hits=lambda: cache.hits,
        misses=lambda: cache.misses,
    )


def _include_routes(app: FastAPI, keys: Keys) -> None:
    """Add all routes, and to those that need a key what asks for it."""
    read: dict[str, Any] = {}
    write: dict[str, Any] = {"responses": problems(403)}
    if keys:
        may_read = Depends(require_key(keys, write=False))
        may_write = Depends(require_key(keys, write=True))
        read = {"dependencies": [may_read], "responses": problems(401)}
        write = {"dependencies": [may_write], "responses": problems(401, 403)}
    # the router tries them in this order: the busiest first
    reading: list[APIRouter] = [
        module.router for module in (queries, health, datasets, runs, jobs, inference)
    ]
    writing: list[APIRouter] = [module.writing for module in (uploads, runs, jobs)]
    for router in reading:
        app.include_router(router, **read)
    for router in writing:
        app.include_router(router, **write)
    for router in (health.open_router, inference.open_router, documentation.router):
        app.include_router(router)


def _lifespan(settings: Settings, metrics: Metrics) -> _Lifespan:
    """Return what opens the context before the first request and closes it after the last."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        context = await asyncio.to_thread(open_context, settings, metrics)
        app.state.context = context
        try:
            yield
        finally:
            try:
                await asyncio.to_thread(context.close)
            except RuntimeError:  # the interpreter is ending, and starts no threads
                context.close()

    return lifespan


def _explain_library_error(settings: Settings, error: SsilDataError) -> Problem:
    return of_library(error, [Store(settings.store).folder.uri])


def _handlers(settings: Settings) -> dict[type[Exception], _Handler]:
    """Return what turns each kind of exception into an answer."""

    async def answer_library_error(request: Request, error: SsilDataError) -> Response:
        return _explain_library_error(settings, error).response(request.url.path)

    return {
        Problem: _answer_problem,
        SsilDataError: answer_library_error,
        RequestValidationError: _answer_validation_error,
        HTTPException: _answer_http_error,
        ClientDisconnect: _answer_disconnected,
        Exception: _answer_unexpected_error,
    }


async def _answer_problem(request: Request, error: Problem) -> Response:
    return error.response(request.url.path)


async def _answer_validation_error(request: Request, error: RequestValidationError) -> Response:
    return of_invalid_request(error.errors()).response(request.url.path)


async def _answer_http_error(request: Request, error: HTTPException) -> Response:
    """Answer what Starlette's router refuses: an unknown path or method, a broken body."""
    path = request.url.path
    headers = dict(error.headers or {})
    detail = "The request could not be read"
    if error.status_code == 404:
        detail = f"Path not found: {path[:200]}"
    if error.status_code == 405:
        methods = ", ".join(find_methods(request.app, path))
        headers["Allow"] = methods
        detail = f"Method not allowed; this path answers {methods or 'no other'}"
    return Problem(error.status_code, detail, headers=headers).response(path)


async def _answer_disconnected(request: Request, error: ClientDisconnect) -> Response:
    """Answer a client that has disconnected: status 499, for the metrics only."""
    return Response(status_code=499)


async def _answer_unexpected_error(request: Request, error: Exception) -> Response:
    return of_fault(error).response(request.url.path)  # the middleware logs it
