"""Datasets: list, card, versions, episodes, pairs."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

import numpy as np
import pyarrow as pa
from fastapi import APIRouter, Query, Request
from pydantic_core import to_json
from starlette.responses import Response

from ssil_data.client.wire import JSON, pairs_table, rows_of_matrix
from ssil_data.errors import SsilDataError
from ssil_data.store.episodes import check_episode
from ssil_data.store.summary import summarize
from ssil_service.context import context
from ssil_service.http.openapi import bulk, problems
from ssil_service.queries.snapshot import Snapshot
from ssil_service.routes.accept import negotiate
from ssil_service.routes.pages import not_modified, page_response, page_rows, tag_of
from ssil_service.routes.parameters import (
    NO_PARAMETERS,
    DatasetName,
    PageParameters,
    PairsParameters,
    VersionParameters,
)
from ssil_service.schemas.responses import (
    Datasets,
    DatasetSummary,
    EpisodesPage,
    PairsPage,
    Versions,
)

router = APIRouter(prefix="/v1", tags=["datasets"])

_PROBLEMS = problems(404, 406, 422, tagged=True)


@router.get(
    "/datasets",
    response_model=Datasets,
    responses=problems(406, tagged=True),
    dependencies=[NO_PARAMETERS],
)
async def datasets(request: Request) -> Response:
    """List the newest version of every dataset.

    Parameters
    ----------
    request
        The request.

    Returns
    -------
    Response
        The datasets that can be read.
    """
    negotiate(request, (JSON,))
    catalog = context(request).catalog
    found = []
    for name in await asyncio.to_thread(catalog.names):
        try:
            found.append(summary(await catalog.snapshot(name)))
        except SsilDataError:
            continue  # deleted meanwhile, or damaged: `ssil-data validate` names the files
    tag = tag_of(found)
    return not_modified(request, tag) or _json({"datasets": found}, tag)


@router.get("/datasets/{dataset}", response_model=DatasetSummary, responses=_PROBLEMS)
async def dataset(
    request: Request, dataset: DatasetName, parameters: Annotated[VersionParameters, Query()]
) -> Response:
    """Show a dataset's newest version, or another.

    Parameters
    ----------
    request
        The request.
    dataset
        Name of the dataset.
    parameters
        The query parameters.

    Returns
    -------
    Response
        Its summary.
    """
    negotiate(request, (JSON,))
    found = summary(await context(request).catalog.snapshot(dataset, parameters.version))
    tag = tag_of(found)
    return not_modified(request, tag) or _json(found, tag)


@router.get(
    "/datasets/{dataset}/versions",
    response_model=Versions,
    responses=_PROBLEMS,
    dependencies=[NO_PARAMETERS],
)
async def versions(request: Request, dataset: DatasetName) -> Response:
    """List the fingerprints of a dataset's versions, the newest last.

    Parameters
    ----------
    request
        The request.
    dataset
        Name of the dataset.

    Returns
    -------
    Response
        The fingerprints.
    """
    negotiate(request, (JSON,))
    catalog = context(request).catalog
    snapshot = await catalog.snapshot(dataset)
    found = await catalog.read(snapshot, lambda dataset: dataset.versions)
    tag = tag_of(found)
    return not_modified(request, tag) or _json({"versions": found}, tag)


@router.get(
    "/datasets/{dataset}/card",
    response_class=Response,
    responses={**_PROBLEMS, 200: {"content": {"text/markdown": {"schema": {"type": "string"}}}}},
    dependencies=[NO_PARAMETERS],
)
async def card(request: Request, dataset: DatasetName) -> Response:
    """Read a dataset's card, Markdown.

    Parameters
    ----------
    request
        The request.
    dataset
        Name of the dataset.

    Returns
    -------
    Response
        The card.
    """
    media = negotiate(request, ("text/markdown",))
    catalog = context(request).catalog
    snapshot = await catalog.snapshot(dataset)
    text = await catalog.read(snapshot, lambda dataset: dataset.card)
    tag = tag_of(text)
    return not_modified(request, tag) or Response(text, media_type=media, headers={"ETag": tag})


@router.get(
    "/datasets/{dataset}/episodes",
    responses={**_PROBLEMS, 200: bulk(EpisodesPage, paged=True)},
)
async def episodes(
    request: Request, dataset: DatasetName, parameters: Annotated[PageParameters, Query()]
) -> Response:
    """Read the episodes: number, length, labeled, source, score, tier, ending.

    Parameters
    ----------
    request
        The request.
    dataset
        Name of the dataset.
    parameters
        The query parameters.

    Returns
    -------
    Response
        One page of them.
    """
    media = negotiate(request)
    snapshot = await context(request).catalog.snapshot(dataset, parameters.version)
    tag = tag_of(dataset, snapshot.version, media, parameters.offset, parameters.limit)
    known = not_modified(request, tag)
    if known is not None:
        return known
    table = snapshot.dataset.episodes
    rows = page_rows(request, media, len(table), parameters, width=table.num_columns)
    part = table.slice(rows.start, rows.stop - rows.start)
    about = {"version": snapshot.version}
    return await page_response(
        request, part, media, rows=rows, total=len(table), tag=tag, about=about
    )


@router.get(
    "/datasets/{dataset}/pairs",
    responses={**_PROBLEMS, 200: bulk(PairsPage, paged=True)},
)
async def pairs(
    request: Request, dataset: DatasetName, parameters: Annotated[PairsParameters, Query()]
) -> Response:
    """Read the pairs in order: episode, step, state, action.

    Parameters
    ----------
    request
        The request.
    dataset
        Name of the dataset.
    parameters
        The query parameters.

    Returns
    -------
    Response
        One page of them.
    """
    media = negotiate(request)
    here = context(request)
    snapshot = await here.catalog.snapshot(dataset, parameters.version)
    chosen = _choose_rows(snapshot, parameters.episode, parameters.labeled)
    choice = (
        parameters.episode,
        parameters.labeled,
        parameters.recorded,
        parameters.offset,
        parameters.limit,
    )
    tag = tag_of("pairs", dataset, snapshot.version, media, choice)
    known = not_modified(request, tag)
    if known is not None:
        return known
    whole = await here.catalog.pairs(snapshot)
    rows = page_rows(request, media, len(chosen), parameters, width=sum(snapshot.widths))
    taken = chosen[rows]
    recorded = parameters.recorded
    if recorded is None:
        part = pairs_table(_take_rows(whole, taken))
    else:
        values = await here.catalog.read(snapshot, lambda dataset: dataset.read_recorded(recorded))
        place = {"episode": whole.episode[taken], "step": whole.step[taken]}
        part = pa.table({**place, recorded: _column(values, taken)})
    about = {"version": snapshot.version}
    return await page_response(
        request, part, media, rows=rows, total=len(chosen), tag=tag, about=about
    )


def summary(snapshot: Snapshot) -> dict[str, Any]:
    """Describe one version of a dataset.

    Parameters
    ----------
    snapshot
        The version.

    Returns
    -------
    dict
        The fields of `DatasetSummary`.
    """
    return dict(summarize(snapshot.dataset, snapshot.runs))


def _json(value: Any, tag: str) -> Response:
    return Response(to_json(value), media_type=JSON, headers={"ETag": tag})


def _choose_rows(snapshot: Snapshot, episode: int | None, labeled: bool) -> Any:
    """Return the rows of the pairs that a query selects."""
    table = snapshot.dataset.episodes
    keep = np.ones(len(table), bool)
    if episode is not None:
        check_episode(snapshot.name, table, episode)
        keep &= table["episode"].to_numpy() == episode
    if labeled:
        keep &= table["labeled"].to_numpy()
    return np.flatnonzero(np.repeat(keep, table["length"].to_numpy()))


def _take_rows(pairs: Any, rows: Any) -> Any:
    """Return rows of pairs; a page of all of them is no copy."""
    if len(rows) and rows[-1] - rows[0] == len(rows) - 1:
        return pairs[int(rows[0]) : int(rows[-1]) + 1]
    keep = np.zeros(len(pairs), bool)
    keep[rows] = True
    return pairs.where(keep)


def _column(values: Any, rows: Any) -> Any:
    if values is None:
        return pa.nulls(len(rows), pa.float32())
    return rows_of_matrix(values[rows]) if values.ndim == 2 else values[rows]
