"""Questions: LCoR and CoR of states, the leverage of pairs never seen."""

from __future__ import annotations

from typing import Annotated, Any

import pyarrow as pa
from fastapi import APIRouter, Query, Request
from starlette.responses import Response

from ssil_data.client.wire import rows_of_matrix
from ssil_data.store.arrow_schema import PARTS
from ssil_service.context import context
from ssil_service.formats.responses import negotiate, table_response
from ssil_service.http.openapi import bulk, bulk_body, problems
from ssil_service.http.route_cache import cache_route
from ssil_service.problems import Fault, Problem
from ssil_service.routes.bodies import read_pairs, read_states, run_off_loop
from ssil_service.routes.pages import most_rows
from ssil_service.routes.parameters import (
    Alpha,
    Contributors,
    DatasetName,
    RunName,
    Seconds,
    Tolerance,
    Version,
)
from ssil_service.schemas.requests import PairsBody, StatesBody
from ssil_service.schemas.responses import CoRAnswer, LCoRAnswer, ScoreAnswer, SumsAnswer

router = APIRouter(prefix="/v1/datasets/{dataset}/runs/{run}", tags=["questions"])

_PROBLEMS = problems(404, 406, 408, 409, 413, 415, 422)


@router.post(
    "/lcor",
    responses={**_PROBLEMS, 200: bulk(LCoRAnswer, SumsAnswer)},
    openapi_extra=bulk_body(StatesBody),
)
@cache_route
async def lcor(
    request: Request,
    dataset: DatasetName,
    run: RunName,
    version: Version = None,
    alpha: Alpha = None,
    contributors: Contributors = 0,
    tolerance: Tolerance = None,
    relative: Annotated[
        bool, Query(description="Tolerance in deviations of LCoR over the demonstrations.")
    ] = False,
    seconds: Seconds = None,
    seed: Annotated[int, Query(ge=0, le=2**63 - 1, description="Equal seeds, equal parts.")] = 0,
    sums: Annotated[
        bool, Query(description="Instead, the weighted sums, which add up over shards.")
    ] = False,
) -> Response:
    """Tell how good the neighbourhood of states is, and on how many states the answer rests."""
    media = negotiate(request)
    here = context(request)
    accuracy = {"tolerance": tolerance, "relative": relative, "seconds": seconds, "seed": seed}
    if sums:
        _refuse_sampled(request)
    snapshot = await here.catalog.snapshot(dataset, version)
    snapshot.run(run)
    states = await read_states(request, snapshot.widths[0])
    most = most_rows(media, 4 + 2 * contributors)
    if contributors and len(states) > most:
        detail = f"at most {most} rows with {contributors} contributors, found {len(states)}"
        raise Problem(413, f"states: expected {detail}")
    field = await here.catalog.field(snapshot, run, alpha)

    def work() -> dict[str, Any]:
        if sums:
            return _sums(field.sums(states, contributors=contributors))
        return _answer(field.lcor(states, contributors=contributors, **accuracy))  # pyright: ignore[reportArgumentType]

    size = len(states) * len(field.states)
    plain = not (sums or contributors or tolerance or relative or seconds or seed)
    if plain and size <= here.batching.most:
        columns = _answer(await here.batching.lcor(field, states))
    else:
        columns = await here.compute(size, work)
    here.metrics.record_rows("lcor", len(states))
    about = {"alpha": field.alpha, "demonstrations": len(field.states)}
    table = pa.table(columns)
    return await run_off_loop(
        table.nbytes, lambda: table_response(table, media, about=about), here.executor_for(media)
    )


@router.post(
    "/cor", responses={**_PROBLEMS, 200: bulk(CoRAnswer)}, openapi_extra=bulk_body(StatesBody)
)
@cache_route
async def cor(
    request: Request,
    dataset: DatasetName,
    run: RunName,
    version: Version = None,
    alpha: Alpha = None,
) -> Response:
    """Tell CoR of states: whether they are nearer to the labeled states or to all others."""
    media = negotiate(request)
    here = context(request)
    snapshot = await here.catalog.snapshot(dataset, version)
    snapshot.run(run)
    states = await read_states(request, snapshot.widths[0])
    field = await here.catalog.field(snapshot, run, alpha)
    values = await here.compute(100 * len(states), lambda: field.cor(states))
    here.metrics.record_rows("cor", len(states))
    table = pa.table({"value": values})
    about = {"alpha": field.alpha}
    return await run_off_loop(
        table.nbytes, lambda: table_response(table, media, about=about), here.executor_for(media)
    )


@router.post(
    "/score", responses={**_PROBLEMS, 200: bulk(ScoreAnswer)}, openapi_extra=bulk_body(PairsBody)
)
@cache_route
async def score(request: Request, dataset: DatasetName, run: RunName) -> Response:
    """Tell the uncertainty and leverage of pairs, seen before or not, by a run of any version."""
    media = negotiate(request)
    here = context(request)
    snapshot = await here.catalog.snapshot(dataset)
    snapshot.run_of_any_version(run)
    pairs = await read_pairs(request, snapshot.widths)
    model = await here.catalog.model(snapshot, run)
    # a pair costs an estimator about what some thousand demonstrations cost LCoR
    scored = await here.compute(4096 * len(pairs), lambda: model(pairs))
    here.metrics.record_rows("score", len(pairs))
    missing = pa.nulls(len(pairs), pa.float32())
    table = pa.table(
        {
            "uncertainty": scored.uncertainty,
            **{part: scored.parts.get(part, missing) for part in PARTS},
            "leverage": scored.leverage,
        }
    )
    return await run_off_loop(
        table.nbytes, lambda: table_response(table, media), here.executor_for(media)
    )


def _refuse_sampled(request: Request) -> None:
    """Raise a Problem if a part of the pairs is asked as well as sums over all of them."""
    faults = [
        Fault(detail=f"{name}: expected none with sums, which are exact", field=name)
        for name in ("tolerance", "relative", "seconds", "seed")
        if name in request.query_params
    ]
    if faults:
        raise Problem(422, f"query: {faults[0].detail}", errors=faults)


def _answer(answer: Any) -> dict[str, Any]:
    columns = {
        "values": answer.values,
        "effective_sample_size": answer.effective_sample_size,
        "half_width": answer.half_width,
    }
    if answer.contributors.row.shape[1]:
        columns["contributor_row"] = rows_of_matrix(answer.contributors.row)
        columns["contributor_share"] = rows_of_matrix(answer.contributors.share)
    return columns


def _sums(sums: Any) -> dict[str, Any]:
    names = ("numerator", "denominator", "squares", "log_scale")
    columns = {name: getattr(sums, name) for name in names}
    if sums.nearest.shape[1]:
        columns["nearest"] = rows_of_matrix(sums.nearest)
        columns["nearest_weight"] = rows_of_matrix(sums.nearest_weight)
    return columns
