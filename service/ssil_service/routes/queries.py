"""Queries: LCoR and CoR of states, the leverage of pairs that are new."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any

import pyarrow as pa
from fastapi import APIRouter, Query, Request
from starlette.responses import Response

from ssil_data.client.wire import rows_of_matrix
from ssil_data.field import LCoR, LCoRQuery
from ssil_data.kernels import Sums
from ssil_data.scoring import Scored
from ssil_data.store.arrow_schema import FIRST_PARTS
from ssil_service.context import COR_COST, SCORE_COST, context
from ssil_service.http.openapi import bulk, bulk_body, problems
from ssil_service.http.route_cache import cache_route
from ssil_service.problems import Problem
from ssil_service.routes.accept import negotiate, table_response
from ssil_service.routes.bodies import read_pairs, read_states
from ssil_service.routes.pages import most_rows
from ssil_service.routes.parameters import (
    NO_PARAMETERS,
    CoRParameters,
    DatasetName,
    LCoRParameters,
    RunName,
)
from ssil_service.schemas.requests import PairsBody, StatesBody
from ssil_service.schemas.responses import CoRAnswer, LCoRAnswer, ScoreAnswer, SumsAnswer

router = APIRouter(prefix="/v1/datasets/{dataset}/runs/{run}", tags=["queries"])

_PROBLEMS = problems(404, 406, 408, 409, 413, 415, 422)
_PLAIN = LCoRQuery()
"""A query without options, which may be computed in a batch with others."""


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
    parameters: Annotated[LCoRParameters, Query()],
) -> Response:
    """Return LCoR of states, and how many demonstrations each value rests on."""
    media = negotiate(request)
    here = context(request)
    parameters.refuse_sampling_with_sums()
    query = parameters.query()
    snapshot = await here.catalog.snapshot(dataset, parameters.version)
    snapshot.check_run(run)
    states = await read_states(request, snapshot.widths[0])
    _refuse_long_answer(len(states), query.contributors, media)
    field = await here.catalog.field(snapshot, run, parameters.alpha)
    size = len(states) * len(field.states)
    if parameters.sums:
        sums = await here.compute(size, lambda: field.sums(states, contributors=query.contributors))
        columns = _sums_columns(sums)
    elif query == _PLAIN and size <= here.batching.most:
        columns = _lcor_columns(await here.batching.lcor(field, states))
    else:
        answer = await here.compute(size, lambda: field.lcor(states, **asdict(query)))
        columns = _lcor_columns(answer)
    here.metrics.record_rows("lcor", len(states))
    about = {"alpha": field.alpha, "demonstrations": len(field.states)}
    return await table_response(request, pa.table(columns), media, about=about)


@router.post(
    "/cor", responses={**_PROBLEMS, 200: bulk(CoRAnswer)}, openapi_extra=bulk_body(StatesBody)
)
@cache_route
async def cor(
    request: Request,
    dataset: DatasetName,
    run: RunName,
    parameters: Annotated[CoRParameters, Query()],
) -> Response:
    """Return CoR of states: above 1/2 where the labeled states are nearer than all others."""
    media = negotiate(request)
    here = context(request)
    snapshot = await here.catalog.snapshot(dataset, parameters.version)
    snapshot.check_run(run)
    states = await read_states(request, snapshot.widths[0])
    field = await here.catalog.field(snapshot, run, parameters.alpha)
    values = await here.compute(COR_COST * len(states), lambda: field.cor(states))
    here.metrics.record_rows("cor", len(states))
    table = pa.table({"value": values})
    return await table_response(request, table, media, about={"alpha": field.alpha})


@router.post(
    "/score",
    responses={**_PROBLEMS, 200: bulk(ScoreAnswer)},
    openapi_extra=bulk_body(PairsBody),
    dependencies=[NO_PARAMETERS],
)
@cache_route
async def score(request: Request, dataset: DatasetName, run: RunName) -> Response:
    """Return uncertainty and leverage of pairs, of the dataset or new, by a run of any version.

    Uncertainty is pooled inside the episodes of the request: a pair that comes alone is judged
    alone. Without `episode`, all rows are one episode.
    """
    media = negotiate(request)
    here = context(request)
    snapshot = await here.catalog.snapshot(dataset)
    snapshot.check_run(run, any_version=True)
    pairs = await read_pairs(request, snapshot.widths)
    model = await here.catalog.model(snapshot, run)
    scored = await here.compute(SCORE_COST * len(pairs), lambda: model(pairs))
    here.metrics.record_rows("score", len(pairs))
    return await table_response(request, _score_table(scored), media)


def _score_table(scored: Scored) -> pa.Table:
    """Return what a model gives as a table; members of an ensemble only if there are any."""
    missing = pa.nulls(len(scored.leverage), pa.float32())
    first = {part: scored.parts.get(part, missing) for part in FIRST_PARTS}
    members = {part: values for part, values in scored.parts.items() if part not in FIRST_PARTS}
    return pa.table(
        {
            "uncertainty": scored.uncertainty,
            **first,
            "leverage": scored.leverage,
            "pooled": scored.pooled,
            **members,
        }
    )


def _refuse_long_answer(rows: int, contributors: int, media: str) -> None:
    """Raise a Problem if the contributors of so many states are more than a body should hold."""
    most = most_rows(media, 4 + 2 * contributors)
    if contributors and rows > most:
        detail = f"expected at most {most} rows with {contributors} contributors, found {rows}"
        raise Problem(413, f"states: {detail}")


def _lcor_columns(answer: LCoR) -> dict[str, Any]:
    """Return LCoR as the columns of the response; those of contributors only if there are any."""
    columns: dict[str, Any] = {
        "values": answer.values,
        "effective_sample_size": answer.effective_sample_size,
        "half_width": answer.half_width,
    }
    if answer.contributors.row.shape[1]:
        columns["contributor_row"] = rows_of_matrix(answer.contributors.row)
        columns["contributor_share"] = rows_of_matrix(answer.contributors.share)
    return columns


def _sums_columns(sums: Sums) -> dict[str, Any]:
    """Return sums as the columns of the response; those of contributors only if there are any."""
    names = ("numerator", "denominator", "squares", "log_scale")
    columns: dict[str, Any] = {name: getattr(sums, name) for name in names}
    if sums.nearest.shape[1]:
        columns["nearest"] = rows_of_matrix(sums.nearest)
        columns["nearest_weight"] = rows_of_matrix(sums.nearest_weight)
    return columns
