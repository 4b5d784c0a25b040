"""Tensors of the Open Inference Protocol: in JSON, or as bytes after it (binary extension)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import chain
from typing import Any

import numpy as np
from pydantic import ValidationError
from pydantic_core import to_json

from ssil_service.problems import Problem, of_validation
from ssil_service.schemas.responses import InferenceRequest, Tensor

_TYPES: dict[str, np.dtype[Any]] = {
    "FP32": np.dtype("<f4"),
    "FP64": np.dtype("<f8"),
    "INT64": np.dtype("<i8"),
}
_NAMES = {dtype: name for name, dtype in _TYPES.items()}
_SIZE = "binary_data_size"


def read(
    body: bytes, header: int | None, *, most_json: int
) -> tuple[InferenceRequest, dict[str, np.ndarray]]:
    """Return a request and its input tensors by name; raises a Problem."""
    length = len(body) if header is None else header
    if length > len(body):
        raise Problem(422, f"body: expected {length} bytes of JSON, found {len(body)}")
    if length > most_json:
        raise Problem(413, f"body: expected at most {most_json} bytes of JSON, found more")
    try:
        request = InferenceRequest.model_validate_json(body[:length])
    except ValidationError as error:
        found = error.errors(include_url=False, include_context=False, include_input=False)
        raise of_validation(found, "body") from None
    inputs: dict[str, np.ndarray] = {}
    place = length
    for tensor in request.inputs:
        if tensor.name in inputs:
            raise Problem(422, "inputs: expected different names, found one twice")
        size = tensor.parameters.get(_SIZE)
        if size is None:
            inputs[tensor.name] = _of_json(tensor)
            continue
        if header is None or type(size) is not int or not 0 <= size <= len(body) - place:
            raise Problem(422, f"inputs: expected as many bytes as {_SIZE} says, found fewer")
        inputs[tensor.name] = _of_bytes(tensor, body[place : place + size])
        place += size
    if place != len(body):
        raise Problem(422, "body: expected only what its header names, found more bytes")
    return _without_defaults(request), inputs


def _without_defaults(request: InferenceRequest) -> InferenceRequest:
    """Return what the answer needs of a request; the rest may take thirty times its length."""
    outputs = [
        output.model_copy(update={"parameters": _only(output.parameters, "binary_data")})
        for output in request.outputs
    ]
    known = _only(request.parameters, "binary_data_output")
    return request.model_copy(update={"inputs": [], "outputs": outputs, "parameters": known})


def _only(parameters: Mapping[str, Any], name: str) -> dict[str, Any]:
    return {name: parameters.get(name) is True}


def write(
    request: InferenceRequest, about: Mapping[str, Any], outputs: Mapping[str, np.ndarray]
) -> tuple[bytes, int | None]:
    """Return the answer to a request, and the length of its JSON if tensors follow it."""
    wanted = {each.name: each.parameters for each in request.outputs} or {
        name: {} for name in outputs
    }
    everything_binary = request.parameters.get("binary_data_output") is True
    shown, tail = [], []
    for name, parameters in wanted.items():
        values = np.ascontiguousarray(outputs[name])
        tensor: dict[str, Any] = {"name": name, "shape": list(values.shape)}
        tensor["datatype"] = _NAMES[values.dtype]
        if parameters.get("binary_data", everything_binary) is True:
            tail.append(values.tobytes())
            tensor["parameters"] = {_SIZE: len(tail[-1])}
        else:
            tensor["data"] = values.tolist()
        shown.append(tensor)
    known = {name: value for name, value in about.items() if value is not None}
    header = to_json({**known, "outputs": shown}, inf_nan_mode="null")
    return b"".join([header, *tail]), len(header) if tail else None


def _of_json(tensor: Tensor) -> np.ndarray:
    """Return the numbers of a tensor, flat or in rows, none of them turned into another."""
    rows = tensor.data or []
    nested = set(map(type, rows)) == {list}
    flat = list(chain.from_iterable(rows)) if nested else rows
    whole = tensor.datatype == "INT64"
    try:
        if nested and {len(row) for row in rows} != {*tensor.shape[1:]}:
            raise ValueError
        if not set(map(type, flat)) <= ({int} if whole else {int, float}):
            raise ValueError
        return np.array(flat, np.int64 if whole else np.float64).reshape(_shape(tensor))
    except (ValueError, OverflowError):
        raise _odd(tensor) from None


def _of_bytes(tensor: Tensor, data: bytes) -> np.ndarray:
    try:
        return np.frombuffer(data, _TYPES[tensor.datatype]).reshape(_shape(tensor))
    except ValueError:
        raise _odd(tensor) from None


def _shape(tensor: Tensor) -> list[int]:
    if math.prod(tensor.shape) > 2**40:
        raise ValueError
    return tensor.shape


def _odd(tensor: Tensor) -> Problem:
    """Return the problem of a tensor whose data are not what its type and shape say."""
    return Problem(
        422, f"inputs: expected {tensor.datatype} numbers of shape {tensor.shape}, found other data"
    )
