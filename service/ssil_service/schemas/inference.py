"""Bodies of the Open Inference Protocol, version 2, both ways."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

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
    """An output that is requested."""

    model_config = ConfigDict(extra="ignore")

    name: str
    parameters: dict[str, Any] = {}


class InferenceRequest(BaseModel):
    """A request of the Open Inference Protocol, version 2."""

    model_config = ConfigDict(extra="ignore")

    id: str | None = None
    inputs: list[Tensor] = Field(min_length=1, max_length=8)
    outputs: list[RequestedOutput] = Field(default=[], max_length=16)
    parameters: dict[str, Any] = {}


class InferenceAnswer(BaseModel):
    """A response of the Open Inference Protocol, version 2."""

    model_name: str
    model_version: str
    id: str | None = None
    outputs: list[Tensor]
    parameters: dict[str, Any] = {}


class ServerMetadata(BaseModel):
    """The server's name, version and extensions."""

    name: str
    version: str
    extensions: list[str]


class TensorMetadata(BaseModel):
    """A model's input or output; −1 is any number of rows."""

    name: str
    datatype: str
    shape: list[int]


class ModelMetadata(BaseModel):
    """The inputs and outputs of a model."""

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
