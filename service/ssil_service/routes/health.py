"""Health checks, metrics and limits."""

from __future__ import annotations

import asyncio

from fastapi import APIRouter, Request
from starlette.responses import JSONResponse, Response

from ssil_service.context import Context, context
from ssil_service.formats.arrow import MOST_BATCHES
from ssil_service.http.openapi import problems
from ssil_service.metrics import CONTENT_TYPE
from ssil_service.problems import busy
from ssil_service.routes.bodies import RUN_BYTES
from ssil_service.routes.parameters import MOST_CONTRIBUTORS, MOST_SECONDS, NO_PARAMETERS
from ssil_service.schemas.responses import Health, Limits

open_router = APIRouter(tags=["operation"], dependencies=[NO_PARAMETERS])
router = APIRouter(tags=["operation"], dependencies=[NO_PARAMETERS])


@open_router.get("/healthz", response_model=Health, responses=problems())
async def alive() -> Response:
    """Tell that the process is alive."""
    return JSONResponse({"status": "ok"})


@open_router.get("/readyz", response_model=Health, responses=problems())
async def ready(request: Request) -> Response:
    """Tell that queries are answered: 503 while shutting down, or without a store.

    Parameters
    ----------
    request
        The request.

    Returns
    -------
    Response
        Status ok.
    """
    await refuse_unready(request)
    return JSONResponse({"status": "ok"})


async def refuse_unready(request: Request) -> None:
    """Refuse if no query could be answered.

    Parameters
    ----------
    request
        Any request.

    Raises
    ------
    Problem
        503 while the service shuts down, or if its store cannot be read.
    """
    here = context(request)
    if here.closing:
        raise busy(503, "The service is shutting down; retry after 1 s", 1)
    if not await asyncio.to_thread(_has_store, here):
        raise busy(503, "The store cannot be read; retry after 1 s", 1)


def _has_store(here: Context) -> bool:
    """Tell whether the store is readable; if its folder has been moved away, it is not empty."""
    return (here.store_folder is None or here.store_folder.is_dir()) and here.catalog.ready()


@router.get(
    "/metrics",
    response_class=Response,
    responses={**problems(), 200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
async def metrics(request: Request) -> Response:
    """Prometheus metrics: latency by route, rows, queue, cache, jobs.

    Parameters
    ----------
    request
        The request.

    Returns
    -------
    Response
        Prometheus's text format.
    """
    here = context(request)
    here.metrics.record_jobs(await asyncio.to_thread(here.jobs.counts))
    return Response(here.metrics.text(), media_type=CONTENT_TYPE)


@router.get("/v1/limits", response_model=Limits, responses=problems())
async def limits(request: Request) -> Response:
    """List the limits of the service.

    Parameters
    ----------
    request
        The request.

    Returns
    -------
    Response
        The limits by name.
    """
    settings = context(request).settings
    known = {
        name: getattr(settings, name) for name in Limits.model_fields if hasattr(settings, name)
    }
    constants = {
        "contributors": MOST_CONTRIBUTORS,
        "seconds": MOST_SECONDS,
        "run_bytes": RUN_BYTES,
        "batches": MOST_BATCHES,
    }
    return JSONResponse({**known, **constants})
