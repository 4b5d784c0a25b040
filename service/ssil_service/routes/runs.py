"""Runs: list, show, their leverage, and the jobs that make them."""

from __future__ import annotations

import asyncio
import hashlib
from typing import Annotated, Any

import numpy as np
import pyarrow as pa
from fastapi import APIRouter, Header, Query, Request
from pydantic_core import to_json
from starlette.responses import Response

from ssil_data.client.wire import IDEMPOTENCY, JSON
from ssil_data.scoring import Recipe
from ssil_data.scoring.labels import check_label_count, check_unlabeled
from ssil_data.store.arrow_schema import FIRST_COLUMNS
from ssil_data.store.episodes import check_episode, check_labeled
from ssil_service.context import Context, context
from ssil_service.http.openapi import bulk, json_body, problems
from ssil_service.jobs.queue import JobRequest
from ssil_service.queries.snapshot import Snapshot
from ssil_service.routes.accept import negotiate
from ssil_service.routes.bodies import media_type, read_settings_body
from ssil_service.routes.pages import not_modified, page_response, page_rows, tag_of
from ssil_service.routes.parameters import (
    NO_PARAMETERS,
    DatasetName,
    LeverageParameters,
    RunName,
)
from ssil_service.schemas.requests import FitBody, RescoreBody
from ssil_service.schemas.responses import Job, LeveragePage, RunRecord, RunRecords

router = APIRouter(prefix="/v1/datasets/{dataset}/runs", tags=["runs"])
writing = APIRouter(prefix="/v1/datasets/{dataset}/runs", tags=["runs"])

_PROBLEMS = problems(404, 406, 422, tagged=True)


@router.get("", response_model=RunRecords, responses=_PROBLEMS, dependencies=[NO_PARAMETERS])
async def runs(request: Request, dataset: DatasetName) -> Response:
    """List the runs of all versions of a dataset, oldest first."""
    negotiate(request, (JSON,))
    snapshot = await context(request).catalog.snapshot(dataset)
    found = sorted(snapshot.runs.values(), key=lambda run: run.created)
    tag = tag_of(found)
    answer = {"runs": [run.to_json() for run in found]}
    return not_modified(request, tag) or _json(answer, tag)


@router.get("/{run}", response_model=RunRecord, responses=_PROBLEMS, dependencies=[NO_PARAMETERS])
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
    parameters: Annotated[LeverageParameters, Query()],
) -> Response:
    """Read a run's values of every pair: episode, step, uncertainty, its parts, leverage.

    Columns that came later are given if they are named: `pooled`, the uncertainty pooled over time,
    and one for each member of an ensemble. They are null where a run has none.
    """
    media = negotiate(request)
    here = context(request)
    snapshot = await here.catalog.snapshot(dataset, parameters.version)
    record = snapshot.run(run)
    if parameters.episode is not None:
        check_episode(snapshot.name, snapshot.dataset.episodes, parameters.episode)
    tag = tag_of(record.created, record.model, snapshot.version, media, _choice(parameters))
    known = not_modified(request, tag)
    if known is not None:
        return known
    table = _select(await here.catalog.values(snapshot, run), parameters)
    rows = page_rows(request, media, len(table), parameters, width=table.num_columns)
    part = table.slice(rows.start, rows.stop - rows.start)
    about = {"run": run, "version": snapshot.version}
    return await page_response(
        request, part, media, rows=rows, total=len(table), tag=tag, about=about
    )


@writing.post(
    "",
    status_code=202,
    response_model=Job,
    responses=problems(404, 408, 409, 413, 415, 422, 429),
    openapi_extra=json_body(FitBody, RescoreBody),
    dependencies=[NO_PARAMETERS],
)
async def start(
    request: Request,
    dataset: DatasetName,
    key: Annotated[str | None, Header(alias=IDEMPOTENCY, pattern=r"^[\x21-\x7e]{1,128}$")] = None,
) -> Response:
    """Start a job that makes a run; it goes on when the client is gone."""
    media_type(request, (JSON,))
    body = _parse(await request.body())
    here = context(request)
    digest = hashlib.sha256(f"{dataset} {body.model_dump_json()}".encode()).hexdigest()
    job = await asyncio.to_thread(here.jobs.find_repeated, key, digest)
    if job is None:
        snapshot = await here.catalog.snapshot(dataset, body.version)
        wanted = await _job_request(here, snapshot, body, digest)
        job = await asyncio.to_thread(here.jobs.submit, wanted, key)
    return Response(
        to_json(job), 202, media_type=JSON, headers={"Location": f"/v1/jobs/{job['job']}"}
    )


def _parse(body: bytes) -> FitBody | RescoreBody:
    """Tell the two bodies apart by what only one of them has, and name what is wrong with it."""
    kind = RescoreBody if b'"fitted"' in body and b'"estimator"' not in body else FitBody
    return read_settings_body(body, kind)


async def _job_request(
    here: Context, snapshot: Snapshot, body: FitBody | RescoreBody, digest: str
) -> JobRequest:
    """Return what the job is to make; raises the library's error for what cannot be made."""
    if isinstance(body, RescoreBody):
        source = snapshot
        if body.fitted.dataset is not None:
            source = await here.catalog.snapshot(body.fitted.dataset)
        prefix = source.run_of_any_version(body.fitted.run).estimator["kind"]
        wanted: dict[str, Any] = {"fitted": body.fitted.model_dump()}
    else:
        recipe = body.recipe()
        _check_labels(snapshot, recipe, body.labels)
        prefix = recipe.estimator.kind
        wanted = {**recipe.to_json(), "labels": body.labels, "seed": body.seed}
    return JobRequest(
        dataset=snapshot.name,
        version=snapshot.version,
        body=wanted,
        run_name=body.run,
        name_prefix=prefix,
        request_digest=digest,
    )


def _check_labels(snapshot: Snapshot, recipe: Recipe, count: int | None) -> None:
    """Refuse at once what the job could not make of the dataset's labels; raises InvalidInputError.

    A version's labels do not change, so that the job will find the same.
    """
    episodes = snapshot.dataset.episodes
    check_labeled(snapshot.name, episodes)
    labeled = episodes["labeled"].to_numpy()
    check_unlabeled(recipe, labeled)
    if count is not None:
        check_label_count(count, int(episodes["length"].to_numpy()[labeled].sum()))


def _choice(parameters: LeverageParameters) -> tuple[Any, ...]:
    """Return what decides about the rows and columns of a page, for its ETag."""
    return (
        parameters.episode,
        parameters.first_step,
        parameters.last_step,
        parameters.columns,
        parameters.offset,
        parameters.limit,
    )


def _select(table: pa.Table, parameters: LeverageParameters) -> pa.Table:
    """Return the rows of an episode and of a range of steps, and the columns that are named.

    Without names, those that clients of the first version know.
    """
    rows = np.ones(len(table), bool)
    steps = table["step"].to_numpy()
    if parameters.episode is not None:
        rows &= table["episode"].to_numpy() == parameters.episode
    if parameters.first_step is not None:
        rows &= steps >= parameters.first_step
    if parameters.last_step is not None:
        rows &= steps <= parameters.last_step
    if not rows.all():
        table = table.filter(pa.array(rows))
    return table.select(list(dict.fromkeys(parameters.columns or FIRST_COLUMNS)))


def _json(value: Any, tag: str) -> Response:
    return Response(to_json(value), media_type=JSON, headers={"ETag": tag})
