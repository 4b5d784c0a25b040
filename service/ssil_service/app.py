"""The application: parts, routes, and every error as a problem."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from functools import partial
from importlib.metadata import version
from typing import Any

from fastapi import Depends, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response

from ssil_data.errors import SsilDataError
from ssil_data.store import Store
from ssil_service.context import Context
from ssil_service.http.middleware import Middleware
from ssil_service.http.openapi import allowed_methods, build_document, problems
from ssil_service.http.route_cache import RouteCache
from ssil_service.jobs.queue import JobQueue
from ssil_service.metrics import Metrics
from ssil_service.problems import Problem, of_fault, of_library, of_validation
from ssil_service.queries.admission import BoundedExecutor
from ssil_service.queries.catalog import Catalog
from ssil_service.routes import datasets, health, inference, jobs, queries, runs, uploads
from ssil_service.routes.parameters import refuse_unknown
from ssil_service.security.authentication import Keys, may_read, may_write
from ssil_service.security.hosts import Hosts
from ssil_service.settings import Settings
from ssil_service.workers.decoding import Decoder
from ssil_service.workers.lease import ServerLease
from ssil_service.workers.pool import Pool

_BASE = 2**29
"""Memory that a worker takes before it has done anything, and some to spare."""


def create_app(settings: Settings, *, hosts: Iterable[str] = ()) -> Middleware:
    """Return the service as an ASGI application; it takes its place when its lifespan begins.

    Without keys it answers to local names only, and to these `hosts`.
    """
    keys, metrics = Keys.of(settings), Metrics()
    app = FastAPI(
        title="ssil-data",
        version=version("ssil-data"),
        summary="Leverage and LCoR of demonstrations",
        lifespan=_lifespan,
        redirect_slashes=False,
        docs_url="/docs",
        redoc_url=None,
    )
    app.state.settings, app.state.keys, app.state.metrics = settings, keys, metrics
    everywhere = Depends(refuse_unknown)
    read: dict[str, Any] = {"dependencies": [everywhere]}
    write: dict[str, Any] = {"dependencies": [everywhere], "responses": problems(403)}
    if keys:
        read = {"dependencies": [Depends(may_read), everywhere], "responses": problems(401)}
        write = {"dependencies": [Depends(may_write), everywhere], "responses": problems(401, 403)}
    for each in (queries, health, datasets, runs, jobs, inference):  # the busiest is tried first
        app.include_router(each.router, **read)
    for each in (uploads, runs, jobs):
        app.include_router(each.writing, **write)
    for each in (health, inference):
        app.include_router(each.open_router, dependencies=[everywhere])
    for kind, handler in _HANDLERS.items():
        app.add_exception_handler(kind, handler)
    app.openapi = lambda: build_document(app)
    return Middleware(
        RouteCache(app, partial(_explain_library_error, app)),
        settings=settings,
        metrics=metrics,
        hosts=None if keys else Hosts.of(settings, hosts),
        context=lambda: getattr(app.state, "context", None),
    )


def open_context(app: FastAPI) -> Context:
    """Make the parts of the service: take a place in the state folder, look at the store."""
    settings: Settings = app.state.settings
    state = ServerLease(settings.state_folder)
    catalogue = Catalog(Store(settings.store), settings.cache_bytes)
    catalogue.sweep()
    gate = BoundedExecutor(settings.computing, settings.waiting)
    texts = BoundedExecutor(1, settings.waiting)
    fits = Pool(state.lock, settings.job_bytes, settings.job_seconds, keep=1)
    bodies = Pool(state.lock, settings.decoded_bytes + _BASE, settings.decode_seconds, keep=1)
    decoder = Decoder(
        state, bodies, query_rows=settings.query_rows, upload_rows=settings.decoded_bytes // 8
    )
    board = JobQueue(
        settings.store, state, fits, running=settings.jobs, waiting=settings.job_queue
    )
    board.start()
    local = catalogue.store.folder.local
    home = local if local is not None and local.is_dir() else None
    app.state.metrics.watch_queries(gate, texts, catalogue.cache)
    return Context(
        settings,
        app.state.keys,
        app.state.metrics,
        state,
        catalogue,
        gate,
        texts,
        decoder,
        board,
        home,
    )


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    app.state.context = context = await asyncio.to_thread(open_context, app)
    try:
        yield
    finally:
        try:
            await asyncio.to_thread(context.close)
        except RuntimeError:  # the interpreter is ending, and starts no threads
            context.close()


async def _handle_problem(request: Request, error: Any) -> Response:
    return error.response(request.url.path)


def _explain_library_error(app: FastAPI, error: SsilDataError) -> Problem:
    return of_library(error, [Store(app.state.settings.store).folder.uri])


async def _handle_library_error(request: Request, error: Any) -> Response:
    return _explain_library_error(request.app, error).response(request.url.path)


async def _handle_validation_error(request: Request, error: Any) -> Response:
    return of_validation(error.errors(), "request").response(request.url.path)


async def _handle_http_error(request: Request, error: Any) -> Response:
    headers = dict(error.headers or {})
    if error.status_code == 405:
        headers["Allow"] = ", ".join(allowed_methods(request.app, request.url.path))
    details = {404: "path: expected one that exists, found another", 405: "method: see Allow"}
    detail = details.get(error.status_code, "request: expected another form")
    return Problem(error.status_code, detail, headers=headers).response(request.url.path)


async def _client_disconnected(request: Request, error: Any) -> Response:
    """Return what nobody hears, and the metrics count as the client's doing."""
    return Response(status_code=499)


async def _handle_unexpected_error(request: Request, error: Any) -> Response:
    return of_fault(error).response(request.url.path)  # the edge logs it


_HANDLERS: dict[type[Exception], Any] = {
    Problem: _handle_problem,
    SsilDataError: _handle_library_error,
    RequestValidationError: _handle_validation_error,
    HTTPException: _handle_http_error,
    ClientDisconnect: _client_disconnected,
    Exception: _handle_unexpected_error,
}
