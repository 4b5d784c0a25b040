"""Jobs: their state, their progress as it happens, and how to stop them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request
from pydantic_core import to_json
from starlette.responses import Response, StreamingResponse

from ssil_data.client.wire import JSON
from ssil_service.context import Context, context
from ssil_service.http.openapi import events as events_of
from ssil_service.http.openapi import problems
from ssil_service.jobs.journal import ENDED
from ssil_service.routes.accept import negotiate
from ssil_service.routes.parameters import NO_PARAMETERS
from ssil_service.schemas.responses import Job, Jobs

router = APIRouter(prefix="/v1/jobs", tags=["jobs"], dependencies=[NO_PARAMETERS])
writing = APIRouter(prefix="/v1/jobs", tags=["jobs"], dependencies=[NO_PARAMETERS])

JobId = Annotated[str, Path(pattern=r"^[0-9a-f]{16}$", description="A job.")]
_POLL_SECONDS = 0.1
_POLLS_PER_COMMENT = 100
"""Every so many polls without a change, a comment tells proxies that the stream is in use."""


@router.get("", response_model=Jobs, responses=problems(406))
async def jobs(request: Request) -> Response:
    """List the jobs of all servers of the store, the newest first.

    Parameters
    ----------
    request
        The request.

    Returns
    -------
    Response
        The jobs.
    """
    negotiate(request, (JSON,))
    return _json({"jobs": await asyncio.to_thread(context(request).jobs.all)})


@router.get("/{job}", response_model=Job, responses=problems(404, 406, 422))
async def job(request: Request, job: JobId) -> Response:
    """Show a job.

    Parameters
    ----------
    request
        The request.
    job
        Id of the job.

    Returns
    -------
    Response
        The job as it is now.
    """
    negotiate(request, (JSON,))
    return _json(await asyncio.to_thread(context(request).jobs.get, job))


@router.get(
    "/{job}/events",
    response_class=StreamingResponse,
    responses={**problems(404, 406, 422), 200: events_of(Job)},
)
async def events(request: Request, job: JobId) -> Response:
    """Follow a job to its end: an event `job` with the whole job at every change.

    Parameters
    ----------
    request
        The request.
    job
        Id of the job.

    Returns
    -------
    Response
        A stream of server-sent events.
    """
    media = negotiate(request, ("text/event-stream",))
    here = context(request)
    await asyncio.to_thread(here.jobs.get, job)
    return StreamingResponse(_events(here, job), media_type=media)


@writing.post("/{job}/cancel", response_model=Job, responses=problems(404, 406, 409, 422))
async def cancel(request: Request, job: JobId) -> Response:
    """Stop a job; nothing of it is kept. One that has ended stays as it is.

    Parameters
    ----------
    request
        The request.
    job
        Id of the job.

    Returns
    -------
    Response
        The job as it is now.
    """
    negotiate(request, (JSON,))
    return _json(await asyncio.to_thread(context(request).jobs.cancel, job))


async def _events(here: Context, job: str) -> AsyncIterator[bytes]:
    """Give the job's changes as events until it ends, or the service does."""
    sent = b""
    quiet = 0
    while True:
        shown = await asyncio.to_thread(here.jobs.get, job)
        now = to_json(shown)
        quiet = 0 if now != sent else quiet + 1
        if now != sent:
            yield b"event: job\ndata: " + now + b"\n\n"
            sent = now
        elif quiet % _POLLS_PER_COMMENT == 0:
            yield b": still here\n\n"
        if shown["state"] in ENDED or here.closing:
            return
        await asyncio.sleep(_POLL_SECONDS)


def _json(value: Any) -> Response:
    return Response(to_json(value), media_type=JSON)
