"""Tensors of the Open Inference Protocol: in JSON, or as bytes after it (its binary extension).

The numbers of a request, which may be megabytes of JSON, are parsed by msgspec apart from the rest
(see `json_arrays`); the rest is a few hundred bytes that pydantic validates as the model that the
OpenAPI document shows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET, DecodeError, Raw, Struct, UnsetType
from msgspec.json import Decoder
from pydantic import ValidationError
from pydantic_core import to_json

from ssil_service.problems import Problem, of_validation
from ssil_service.schemas.inference import InferenceRequest, Tensor

_TYPES: dict[str, np.dtype[Any]] = {
    "FP32": np.dtype("<f4"),
    "FP64": np.dtype("<f8"),
    "INT64": np.dtype("<i8"),
}
_NAMES = {dtype: name for name, dtype in _TYPES.items()}
_SIZE = "binary_data_size"
_MOST_NUMBERS = 2**40
"""Numbers that a shape may promise; NumPy's product would overflow."""


class _Parameters(Struct):
    """The parameters that the service knows; all others are left out while parsing."""

    binary_data_size: Raw | UnsetType = UNSET
    binary_data: Raw | UnsetType = UNSET
    binary_data_output: Raw | UnsetType = UNSET


class _Tensor(Struct):
    name: Raw | UnsetType = UNSET
    shape: Raw | UnsetType = UNSET
    datatype: Raw | UnsetType = UNSET
    data: Raw | UnsetType = UNSET
    parameters: _Parameters | UnsetType = UNSET


class _Output(Struct):
    name: Raw | UnsetType = UNSET
    parameters: _Parameters | UnsetType = UNSET


class _Request(Struct):
    """A request of which nothing but the structure is parsed."""

    id: Raw | UnsetType = UNSET
    inputs: list[_Tensor] | UnsetType = UNSET
    outputs: list[_Output] | UnsetType = UNSET
    parameters: _Parameters | UnsetType = UNSET


_REQUEST = Decoder(_Request)


def read(
    body: bytes, header: int | None, *, most_json: int
) -> tuple[InferenceRequest, dict[str, np.ndarray]]:
    """Read a request.

    Parameters
    ----------
    body
        JSON, followed by binary tensors if there is a header.
    header
        Length of the JSON as the request's header gives it, None for all of the body.
    most_json
        Bytes that the JSON may have.

    Returns
    -------
    request : InferenceRequest
        Without its inputs and without parameters that the service does not know.
    inputs : dict
        The input tensors by name, of the shapes that the request gives.

    Raises
    ------
    Problem
        413 for too much JSON, 422 for what is no request, naming the offending fields.
    """
    length = len(body) if header is None else header
    if length > len(body):
        raise Problem(422, f"body: expected {length} bytes of JSON, found {len(body)}")
    if length > most_json:
        raise Problem(413, f"body: expected at most {most_json} bytes of JSON, found {length}")
    rest, data = _set_data_apart(body[:length])
    try:
        request = InferenceRequest.model_validate_json(rest)
    except ValidationError as error:
        found = error.errors(include_url=False, include_context=False, include_input=False)
        raise of_validation(found, "body") from None
    inputs: dict[str, np.ndarray] = {}
    place = length
    for tensor, numbers in zip(request.inputs, data, strict=True):
        if tensor.name in inputs:
            raise Problem(422, "inputs: two tensors have the same name")
        size = tensor.parameters.get(_SIZE)
        if size is None:
            inputs[tensor.name] = _from_json(tensor, numbers)
            continue
        if header is None or type(size) is not int or not 0 <= size <= len(body) - place:
            raise Problem(422, f"inputs: fewer bytes after the JSON than {_SIZE} says")
        inputs[tensor.name] = _from_bytes(tensor, body[place : place + size])
        place += size
    if place != len(body):
        raise Problem(422, "body: more bytes than the JSON's tensors have")
    return _without_inputs(request), inputs


def write(
    request: InferenceRequest, about: Mapping[str, Any], outputs: Mapping[str, np.ndarray]
) -> tuple[bytes, int | None]:
    """Write an answer.

    Parameters
    ----------
    request
        Says which outputs are wanted, and which of them as bytes; without any, all are.
    about
        Further fields of the answer; None is left out.
    outputs
        Tensors by name, of float32, float64 or int64.

    Returns
    -------
    body : bytes
        JSON, followed by the binary tensors.
    header : int or None
        Length of the JSON if binary tensors follow it.
    """
    wanted = {each.name: each.parameters for each in request.outputs} or {
        name: {} for name in outputs
    }
    all_binary = request.parameters.get("binary_data_output") is True
    shown: list[dict[str, Any]] = []
    tail: list[bytes] = []
    for name, parameters in wanted.items():
        values = np.ascontiguousarray(outputs[name])
        tensor: dict[str, Any] = {"name": name, "shape": list(values.shape)}
        tensor["datatype"] = _NAMES[values.dtype]
        if parameters.get("binary_data", all_binary) is True:
            tail.append(values.tobytes())
            tensor["parameters"] = {_SIZE: len(tail[-1])}
        else:
            tensor["data"] = values.tolist()
        shown.append(tensor)
    known = {name: value for name, value in about.items() if value is not None}
    header = to_json({**known, "outputs": shown}, inf_nan_mode="null")
    return b"".join([header, *tail]), len(header) if tail else None


def _set_data_apart(body: bytes) -> tuple[bytes, list[Raw | UnsetType]]:
    """Return a request's JSON without the data of its inputs, and these data, still JSON.

    A body of another structure is returned as it is, for pydantic to say what is wrong with it.
    """
    try:
        request = _REQUEST.decode(body)
    except (DecodeError, UnicodeDecodeError, RecursionError):
        return body, []
    tensors = [] if request.inputs is UNSET else request.inputs
    data = [tensor.data for tensor in tensors]
    for tensor in tensors:
        tensor.data = UNSET
    return msgspec.json.encode(request), data


def _without_inputs(request: InferenceRequest) -> InferenceRequest:
    """Return what the answer needs of a request."""
    outputs = [
        output.model_copy(update={"parameters": _flag(output.parameters, "binary_data")})
        for output in request.outputs
    ]
    parameters = _flag(request.parameters, "binary_data_output")
    return request.model_copy(update={"inputs": [], "outputs": outputs, "parameters": parameters})


def _flag(parameters: Mapping[str, Any], name: str) -> dict[str, bool]:
    """Return one parameter as true or false; if it is absent, there is no parameter."""
    return {name: parameters.get(name) is True}


_FLAT = {"INT64": Decoder(list[int] | None)}
_ROWS = {"INT64": Decoder(list[tuple[int, ...]])}
_FLAT_FLOATS = Decoder(list[float] | None)
_FLOAT_ROWS = Decoder(list[tuple[float, ...]])


def _from_json(tensor: Tensor, data: Raw | UnsetType) -> np.ndarray:
    """Return the numbers of a tensor, flat or in rows, none of them converted to another type."""
    dtype = np.int64 if tensor.datatype == "INT64" else np.float64
    try:
        return np.array(_parse_numbers(tensor, data), dtype).reshape(_shape(tensor))
    except (ValueError, OverflowError, RecursionError):
        raise _mismatch(tensor) from None


def _parse_numbers(tensor: Tensor, data: Raw | UnsetType) -> Sequence[Any]:
    """Return a list of numbers, or of rows as long as the tensor's; raises ValueError."""
    if data is UNSET:
        return []
    try:
        return _FLAT.get(tensor.datatype, _FLAT_FLOATS).decode(data) or []
    except DecodeError:
        rows = _ROWS.get(tensor.datatype, _FLOAT_ROWS).decode(data)
    if {len(row) for row in rows} != {*tensor.shape[1:]}:
        raise ValueError("rows")
    return rows


def _from_bytes(tensor: Tensor, data: bytes) -> np.ndarray:
    try:
        return np.frombuffer(data, _TYPES[tensor.datatype]).reshape(_shape(tensor))
    except ValueError:
        raise _mismatch(tensor) from None


def _shape(tensor: Tensor) -> list[int]:
    if math.prod(tensor.shape) > _MOST_NUMBERS:
        raise ValueError("shape")
    return tensor.shape


def _mismatch(tensor: Tensor) -> Problem:
    """Return the problem of a tensor whose data are not what its type and shape say."""
    return Problem(
        422, f"inputs: expected {tensor.datatype} numbers of shape {tensor.shape}, found other data"
    )
