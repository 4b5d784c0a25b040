"""Parameters that several routes take."""

from __future__ import annotations

from typing import Annotated

from fastapi import Path, Query, Request
from fastapi.dependencies.utils import get_flat_params
from fastapi.params import Query as QueryField

from ssil_service.problems import SHOWN, Fault, Problem
from ssil_service.schemas.requests import NAME

MOST_CONTRIBUTORS = 256
MOST_SECONDS = 60.0

DatasetName = Annotated[str, Path(pattern=NAME, description="A dataset of the store.")]
RunName = Annotated[str, Path(pattern=NAME, description="A run of the dataset.")]
Version = Annotated[
    str | None,
    Query(pattern=r"^[0-9a-f]{16}$", description="The dataset's fingerprint; the newest without."),
]
Alpha = Annotated[
    float | None,
    Query(ge=1e-6, le=1e8, allow_inf_nan=False, description="Sharpness instead of the run's."),
]
Contributors = Annotated[
    int,
    Query(ge=0, le=MOST_CONTRIBUTORS, description="Also name this many states that weigh most."),
]
Offset = Annotated[int, Query(ge=0, le=2**63 - 1, description="Rows to leave out.")]
Limit = Annotated[
    int | None, Query(ge=1, le=2**63 - 1, description="Rows at most; `/v1/limits` has the ceiling.")
]
Episode = Annotated[int | None, Query(ge=0, le=2**63 - 1, description="Rows of this episode only.")]
Tolerance = Annotated[
    float | None,
    Query(
        gt=0,
        le=1e9,
        allow_inf_nan=False,
        description="Ask a random part of the pairs, for 99.9 % half-widths this small.",
    ),
]
Seconds = Annotated[
    float | None,
    Query(
        gt=0,
        le=MOST_SECONDS,
        allow_inf_nan=False,
        description="Ask as large a random part of the pairs as this time allows.",
    ),
]


async def refuse_unknown(request: Request) -> None:
    """Raise a Problem naming the query parameters that the route has not."""
    if not request.scope["query_string"]:
        return
    known = {
        parameter.alias
        for parameter in get_flat_params(request.scope["route"].dependant)
        if isinstance(parameter.field_info, QueryField)
    }
    odd = [name[:100] for name in request.query_params if name not in known]
    if odd:
        faults = [Fault(detail=f"{n}: expected no such parameter", field=n) for n in odd[:SHOWN]]
        raise Problem(422, f"query: {faults[0].detail}", errors=faults)
