"""Bulk answers as JSON: the columns of the Arrow form, and what is said of all rows at once."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field


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


class LeveragePage(_Page):
    """What a run says of pairs; all columns, or those that were asked for."""

    run: str
    episode: list[int] | None = None
    step: list[int] | None = None
    uncertainty: list[float | None] | None = None
    aleatoric: list[float | None] | None = None
    epistemic: list[float | None] | None = None
    leverage: list[float] | None = None


class LCoRAnswer(BaseModel):
    """LCoR of each state, how many demonstrations it rests on, its 99.9 % half-width (0: exact).

    Contributors, where asked for, are rows of the dataset's pairs, heaviest first, and the share
    of the answer's weight that each has.
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
    """CoR of each state."""

    alpha: float
    value: list[float]


class ScoreAnswer(BaseModel):
    """Uncertainty, its parts where the estimator has any, and leverage of each pair."""

    uncertainty: list[float | None]
    aleatoric: list[float | None]
    epistemic: list[float | None]
    leverage: list[float]


Length = Annotated[int, Field(ge=0, le=2**40)]


class Tensor(BaseModel):
    """A tensor of the Open Inference Protocol; `data` in row-major order, flat or nested."""

    model_config = ConfigDict(extra="ignore")

    name: str
    shape: list[Length] = Field(min_length=1, max_length=2)
    datatype: Literal["FP32", "FP64", "INT64"]
    data: list[Any] | None = None
    parameters: dict[str, Any] = {}


class RequestedOutput(BaseModel):
    """An output that is wanted."""

    model_config = ConfigDict(extra="ignore")

    name: str
    parameters: dict[str, Any] = {}


class InferenceRequest(BaseModel):
    """A question of the Open Inference Protocol, version 2."""

    model_config = ConfigDict(extra="ignore")

    id: str | None = None
    inputs: list[Tensor] = Field(min_length=1, max_length=8)
    outputs: list[RequestedOutput] = Field(default=[], max_length=16)
    parameters: dict[str, Any] = {}


class InferenceAnswer(BaseModel):
    """An answer of the Open Inference Protocol, version 2."""

    model_name: str
    model_version: str
    id: str | None = None
    outputs: list[Tensor]
    parameters: dict[str, Any] = {}


class ServerMetadata(BaseModel):
    """What the server is."""

    name: str
    version: str
    extensions: list[str]


class TensorMetadata(BaseModel):
    """A model's input or output; −1 is any number of rows."""

    name: str
    datatype: str
    shape: list[int]


class ModelMetadata(BaseModel):
    """What a model takes and gives."""

    name: str
    versions: list[str]
    platform: str
    inputs: list[TensorMetadata]
    outputs: list[TensorMetadata]


class Ready(BaseModel):
    """Whether a server or a model is ready."""

    name: str | None = None
    ready: bool = True
    live: bool = True
