"""Datasets that clients write: create, append, delete."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from pydantic_core import to_json
from starlette.responses import Response

from ssil_data.client.wire import ARROW, IDEMPOTENCY, JSON, PARQUET
from ssil_data.errors import ConflictError
from ssil_service.context import context
from ssil_service.http.openapi import problems, upload_body
from ssil_service.problems import Problem
from ssil_service.routes.bodies import media_type
from ssil_service.routes.datasets import summary
from ssil_service.routes.pages import refuse_unmatched, tag_of
from ssil_service.routes.parameters import NO_PARAMETERS, DatasetName, LayoutParameters
from ssil_service.schemas.responses import DatasetSummary

writing = APIRouter(prefix="/v1/datasets/{dataset}", tags=["datasets"])

_PROBLEMS = problems(408, 409, 412, 413, 415, 422)
_WRITTEN: dict[str, Any] = {
    "status_code": 201,
    "response_model": DatasetSummary,
    "openapi_extra": upload_body(),
}
Layout = Annotated[LayoutParameters, Query()]


@writing.put("", responses=_PROBLEMS, **_WRITTEN)
async def create(request: Request, dataset: DatasetName, layout: Layout) -> Response:
    """Write a new dataset from a Parquet or Arrow body; it appears whole or not at all."""
    _refuse_key(request)
    refuse_unmatched(request, None)
    media = media_type(request, (ARROW, PARQUET))
    here = context(request)
    if dataset in await asyncio.to_thread(here.catalog.names):
        raise ConflictError(f"dataset: the name {dataset!r} is taken; give another")
    return await _write(request, dataset, layout, media, append=False)


@writing.post("/episodes", responses={**_PROBLEMS, **problems(404)}, **_WRITTEN)
async def append(request: Request, dataset: DatasetName, layout: Layout) -> Response:
    """Add the episodes of a Parquet or Arrow body: the dataset's next version.

    With `If-Match`, the ETag of the dataset, only to the version that has it.
    """
    _refuse_key(request)
    media = media_type(request, (ARROW, PARQUET))
    snapshot = await context(request).catalog.snapshot(dataset)
    refuse_unmatched(request, tag_of(summary(snapshot)))
    return await _write(request, dataset, layout, media, append=True)


@writing.delete(
    "", status_code=204, responses=problems(404, 409, 412, 422), dependencies=[NO_PARAMETERS]
)
async def delete(request: Request, dataset: DatasetName) -> Response:
    """Delete a dataset with its runs; with `If-Match`, its ETag, only if it is still that."""
    _refuse_key(request)
    if "if-match" in request.headers:  # a damaged one can be deleted without being read
        snapshot = await context(request).catalog.snapshot(dataset)
        refuse_unmatched(request, tag_of(summary(snapshot)))
    await asyncio.to_thread(context(request).catalog.remove, dataset)
    return Response(status_code=204)


def _refuse_key(request: Request) -> None:
    """Raise a Problem for an idempotency key: an upload that is sent twice is written twice."""
    if IDEMPOTENCY in request.headers:
        raise Problem(
            422,
            f"{IDEMPOTENCY}: only requests for runs are made once per key; send uploads without",
        )


async def _write(
    request: Request, dataset: str, layout: LayoutParameters, media: str, *, append: bool
) -> Response:
    here = context(request)
    version = await here.decoder.upload(
        request.stream(),
        store=here.settings.store,
        dataset=dataset,
        media=media,
        append=append,
        layout=layout.columns(),
        file=layout.file,
    )
    found = summary(await here.catalog.snapshot(dataset, version))
    headers = {"Location": f"/v1/datasets/{dataset}"}
    return Response(to_json(found), 201, media_type=JSON, headers=headers)
