"""Runs: list, show, their leverage, and the jobs that make them."""

from __future__ import annotations

import asyncio
import hashlib
from typing import Annotated, Any, Literal

import numpy as np
import pyarrow as pa
from fastapi import APIRouter, Header, Query, Request
from pydantic_core import to_json
from starlette.responses import Response

from ssil_data import scales
from ssil_data.client.wire import IDEMPOTENCY, JSON
from ssil_data.estimators import from_json
from ssil_data.estimators import to_json as settings_json
from ssil_service.context import Context, context
from ssil_service.formats.responses import negotiate
from ssil_service.http.openapi import bulk, json_body, problems
from ssil_service.jobs.queue import JobRequest
from ssil_service.queries.catalog import Snapshot
from ssil_service.routes.bodies import media_type, read_settings_body
from ssil_service.routes.datasets import refuse_unknown_episode
from ssil_service.routes.pages import not_modified, page_response, page_rows, tag_of
from ssil_service.routes.parameters import DatasetName, Episode, Limit, Offset, RunName, Version
from ssil_service.schemas.requests import FitBody, Job, RescoreBody, RunRecord, RunRecords
from ssil_service.schemas.responses import LeveragePage

router = APIRouter(prefix="/v1/datasets/{dataset}/runs", tags=["runs"])
writing = APIRouter(prefix="/v1/datasets/{dataset}/runs", tags=["runs"])

_PROBLEMS = problems(404, 406, 422, tagged=True)
Step = Annotated[int | None, Query(ge=0, le=2**63 - 1)]
Columns = Annotated[
    list[Literal["episode", "step", "uncertainty", "aleatoric", "epistemic", "leverage"]] | None,
    Query(description="These columns only."),
]


@router.get("", response_model=RunRecords, responses=_PROBLEMS)
async def runs(request: Request, dataset: DatasetName) -> Response:
    """List the runs of all versions of a dataset, oldest first."""
    negotiate(request, (JSON,))
    snapshot = await context(request).catalog.snapshot(dataset)
    found = sorted(snapshot.runs.values(), key=lambda run: run.created)
    tag = tag_of(found)
    answer = {"runs": [run.to_json() for run in found]}
    return not_modified(request, tag) or _json(answer, tag)


@router.get("/{run}", response_model=RunRecord, responses=_PROBLEMS)
async def run(request: Request, dataset: DatasetName, run: RunName) -> Response:
    """Show a run of any version."""
    negotiate(request, (JSON,))
    found = (await context(request).catalog.snapshot(dataset)).run_of_any_version(run)
    tag = tag_of(found)
    return not_modified(request, tag) or _json(found.to_json(), tag)


@router.get(
    "/{run}/leverage",
    responses={**_PROBLEMS, **problems(409), 200: bulk(LeveragePage, paged=True)},
)
async def leverage(
    request: Request,
    dataset: DatasetName,
    run: RunName,
    version: Version = None,
    episode: Episode = None,
    first_step: Step = None,
    last_step: Step = None,
    columns: Columns = None,
    offset: Offset = 0,
    limit: Limit = None,
) -> Response:
    """Read what a run says of every pair: episode, step, uncertainty, its parts, leverage."""
    media = negotiate(request)
    here = context(request)
    snapshot = await here.catalog.snapshot(dataset, version)
    record = snapshot.run(run)
    if episode is not None:
        refuse_unknown_episode(snapshot, episode)
    choice = (episode, first_step, last_step, columns, offset, limit)
    tag = tag_of(record.created, record.model, snapshot.version, media, choice)
    known = not_modified(request, tag)
    if known is not None:
        return known
    table = await here.catalog.values(snapshot, run)
    if (episode, first_step, last_step) != (None, None, None):
        table = table.filter(_within(table, episode, first_step, last_step))
    if columns:
        table = table.select(list(dict.fromkeys(columns)))
    rows = page_rows(request, media, len(table), offset, limit, table.num_columns)
    part = table.slice(rows.start, rows.stop - rows.start)
    about = {"run": run, "version": snapshot.version}
    return await page_response(request, media, part, rows, len(table), tag, **about)


@writing.post(
    "",
    status_code=202,
    response_model=Job,
    responses=problems(404, 408, 409, 413, 415, 422, 429),
    openapi_extra=json_body(FitBody, RescoreBody),
)
async def start(
    request: Request,
    dataset: DatasetName,
    key: Annotated[str | None, Header(alias=IDEMPOTENCY, pattern=r"^[\x21-\x7e]{1,128}$")] = None,
) -> Response:
    """Have a run made: the job is accepted, and goes on when nobody waits for it."""
    media_type(request, (JSON,))
    body = _parse(await request.body())
    here = context(request)
    asked = hashlib.sha256(f"{dataset} {body.model_dump_json()}".encode()).hexdigest()
    job = await asyncio.to_thread(here.jobs.find_repeated, key, asked)
    if job is None:
        snapshot = await here.catalog.snapshot(dataset, body.version)
        order = await _job_request(here, snapshot, body, asked)
        job = await asyncio.to_thread(here.jobs.submit, order, key)
    return Response(
        to_json(job), 202, media_type=JSON, headers={"Location": f"/v1/jobs/{job['job']}"}
    )


def _parse(body: bytes) -> FitBody | RescoreBody:
    """Tell the two bodies apart by what only one of them has, and name what is wrong with it."""
    kind = RescoreBody if b'"fitted"' in body and b'"estimator"' not in body else FitBody
    return read_settings_body(body, kind)


async def _job_request(
    here: Context, snapshot: Snapshot, body: FitBody | RescoreBody, asked: str
) -> JobRequest:
    """Return what the job is to make; raises the library's error for what cannot be."""
    if isinstance(body, RescoreBody):
        source = snapshot
        if body.fitted.dataset is not None:
            source = await here.catalog.snapshot(body.fitted.dataset)
        stem = source.run_of_any_version(body.fitted.run).estimator["kind"]
        made: dict[str, Any] = {"fitted": body.fitted.model_dump()}
    else:
        estimator = from_json(body.estimator.model_dump())
        stem = estimator.kind
        made = {
            "estimator": settings_json(estimator),
            "scale": scales.to_json(scales.settings_from_json(body.scale.model_dump())),
            "labeled_is_one": body.labeled_is_one,
            "seed": body.seed,
        }
    return JobRequest(
        dataset=snapshot.name, version=snapshot.version, body=made, run_name=body.run,
        name_prefix=stem, request_digest=asked,
    )


def _within(table: pa.Table, episode: int | None, first: int | None, last: int | None) -> pa.Array:
    keep = np.ones(len(table), bool)
    steps = table["step"].to_numpy()
    if episode is not None:
        keep &= table["episode"].to_numpy() == episode
    if first is not None:
        keep &= steps >= first
    if last is not None:
        keep &= steps <= last
    return pa.array(keep)


def _json(value: Any, tag: str) -> Response:
    return Response(to_json(value), media_type=JSON, headers={"ETag": tag})
