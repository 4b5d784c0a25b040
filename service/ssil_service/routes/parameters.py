"""Parameters that several routes take."""

from __future__ import annotations

from typing import Annotated

from fastapi import Path, Query

from ssil_service.schemas import NAME

MOST_CONTRIBUTORS = 256

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
        le=60,
        allow_inf_nan=False,
        description="Ask as large a random part of the pairs as this time allows.",
    ),
]
