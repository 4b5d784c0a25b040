"""Responses as JSON: datasets, runs, jobs, limits, and the columns of bulk answers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, get_type_hints

from pydantic import BaseModel, create_model

from ssil_data.store import summary
from ssil_data.store.arrow_schema import FIRST_PARTS, PARTS
from ssil_data.store.run_record import Run


def _json_fields(declared: type, keys: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Return the fields of a model from a class that declares them, some under other keys."""
    renamed = keys or {}
    hints = get_type_hints(declared)
    return {renamed.get(name, name): (hint, ...) for name, hint in hints.items()}


DatasetSummary = create_model(
    "DatasetSummary",
    __doc__="A dataset's newest version, or the one that was requested.",
    **_json_fields(summary.DatasetSummary),
)
"""A dataset as JSON: the keys of `ssil_data.store.summary.DatasetSummary`."""


class Datasets(BaseModel):
    """The datasets of the store."""

    datasets: list[DatasetSummary]  # pyright: ignore[reportInvalidTypeForm]


class Versions(BaseModel):
    """The fingerprints of all versions, the newest last."""

    versions: list[str]


RunRecord = create_model(
    "RunRecord",
    __doc__="A scoring run: what it was made from, how, and what it needs to be used.",
    **_json_fields(Run, {"name": "run"}),
)
"""The record of a run as JSON: the fields of `ssil_data.Run`, whose name is under the key `run`."""


class RunRecords(BaseModel):
    """The runs of all versions of a dataset, oldest first."""

    runs: list[RunRecord]  # pyright: ignore[reportInvalidTypeForm]


class Progress(BaseModel):
    """How far a job is with one of its steps: `done` of `of`."""

    what: str
    done: int
    of: int


class JobError(BaseModel):
    """Why a job made no run: the kind of the error and its message."""

    kind: str
    detail: str


class Job(BaseModel):
    """A scoring job."""

    job: str
    state: Literal["queued", "running", "succeeded", "failed", "cancelled"]
    dataset: str
    run: str | None
    progress: Progress | None
    error: JobError | None
    created: str
    started: str | None
    ended: str | None


class Jobs(BaseModel):
    """Jobs, the newest first."""

    jobs: list[Job]


class Health(BaseModel):
    """Whether the service is alive, or ready."""

    status: str


class Limits(BaseModel):
    """What the service takes at most."""

    body_bytes: int
    json_bytes: int
    run_bytes: int
    held_bytes: int
    upload_bytes: int
    decoded_bytes: int
    query_rows: int
    batches: int
    page_rows: int
    contributors: int
    seconds: float
    requests: int
    event_streams: int
    connections: int
    computing: int
    waiting: int
    jobs: int
    job_queue: int
    job_seconds: float
    decode_seconds: float
    body_seconds: float
    send_seconds: float


class _Page(BaseModel):
    """Some of `total` rows, from `offset` on."""

    offset: int
    total: int
    version: str


class EpisodesPage(_Page):
    """Episodes, in order."""

    episode: list[int]
    length: list[int]
    labeled: list[bool]
    source: list[str | None]
    score: list[float | None]
    tier: list[str | None]
    ending: list[str | None]


class PairsPage(_Page):
    """Pairs in raw units; or, instead of states and actions, what was recorded."""

    episode: list[int]
    step: list[int]
    state: list[list[float]] | None = None
    action: list[list[float]] | None = None
    reward: list[float | None] | None = None
    position: list[list[float] | None] | None = None


class _FirstColumns(_Page):
    run: str
    episode: list[int] | None = None
    step: list[int] | None = None
    uncertainty: list[float | None] | None = None
    aleatoric: list[float | None] | None = None
    epistemic: list[float | None] | None = None
    leverage: list[float] | None = None


_MEMBERS: dict[str, Any] = {
    name: (list[float | None] | None, None) for name in PARTS if name not in FIRST_PARTS
}

LeveragePage = create_model(
    "LeveragePage",
    __base__=_FirstColumns,
    __doc__="Values of a run: the columns that were requested, or those up to leverage. `pooled` is"
    " the uncertainty pooled over time; the others are the members of an ensemble.",
    pooled=(list[float | None] | None, None),
    **_MEMBERS,
)
"""The values of a run as JSON: columns of `ssil_data.store.arrow_schema.VALUES`."""


class LCoRAnswer(BaseModel):
    """LCoR of each state, how many demonstrations it rests on, its 99.9 % half-width (0: exact).

    Contributors, if requested, are rows of the dataset's pairs, heaviest first, and the share of
    the value's weight that each has.
    """

    alpha: float
    demonstrations: int
    values: list[float]
    effective_sample_size: list[float]
    half_width: list[float]
    contributor_row: list[list[int]] | None = None
    contributor_share: list[list[float]] | None = None


class SumsAnswer(BaseModel):
    """Σ l w, Σ w and Σ w² of each state, with w = k / exp(log_scale): they add up over shards."""

    alpha: float
    demonstrations: int
    numerator: list[float]
    denominator: list[float]
    squares: list[float]
    log_scale: list[float]
    nearest: list[list[int]] | None = None
    nearest_weight: list[list[float]] | None = None


class CoRAnswer(BaseModel):
    """CoR of each state: above 1/2 where the labeled states are nearer than all others."""

    alpha: float
    value: list[float]


class _ScoreColumns(BaseModel):
    uncertainty: list[float | None]
    aleatoric: list[float | None]
    epistemic: list[float | None]
    leverage: list[float]
    pooled: list[float | None]


ScoreAnswer = create_model(
    "ScoreAnswer",
    __base__=_ScoreColumns,
    __doc__="Uncertainty, its parts where the estimator has any, leverage, and the uncertainty"
    " pooled inside the episodes of the request: a pair that comes alone is judged alone.",
    **_MEMBERS,
)
"""What a model gives pairs, as JSON; an ensemble also names the uncertainty of each member."""
