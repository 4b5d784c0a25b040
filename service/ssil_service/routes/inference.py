"""The Open Inference Protocol, version 2: fitted estimators and fields as models.

`<dataset>.<run>` gives the uncertainty and leverage of pairs, pooled inside the episodes of one
request; a pair that comes alone is judged alone. `<dataset>.<run>.lcor` and `….cor` give LCoR and
CoR of states. A model's version is the version of the dataset that its run was made from;
a model whose version is named answers however much the dataset has grown since.
"""

from __future__ import annotations

from importlib.metadata import version
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Header, Path, Request
from pydantic_core import to_json
from starlette.responses import Response

from ssil_data.client.wire import JSON
from ssil_data.demonstrations import Pairs
from ssil_service.context import COR_COST, SCORE_COST, Context, context
from ssil_service.formats import inference_tensors as tensors
from ssil_service.formats.arrays import check_float32
from ssil_service.formats.query_bodies import number_steps
from ssil_service.http.openapi import json_body, problems
from ssil_service.problems import Problem
from ssil_service.queries.model_names import Model, find_model
from ssil_service.routes.bodies import media_type
from ssil_service.routes.health import refuse_unready
from ssil_service.routes.parameters import NO_PARAMETERS
from ssil_service.schemas.inference import (
    InferenceAnswer,
    InferenceRequest,
    ModelMetadata,
    Ready,
    ServerMetadata,
)

open_router = APIRouter(prefix="/v2", tags=["inference"], dependencies=[NO_PARAMETERS])
router = APIRouter(prefix="/v2", tags=["inference"], dependencies=[NO_PARAMETERS])

ModelName = Annotated[str, Path(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,209}$")]
ModelVersion = Annotated[str, Path(pattern=r"^[0-9a-f]{16}$")]
_OUTPUTS = {
    "lcor": {"values": "FP64", "effective_sample_size": "FP64"},
    "cor": {"values": "FP64"},
    "": {"uncertainty": "FP32", "leverage": "FP32", "pooled": "FP32"},
}
_BINARY_AFTER = "Inference-Header-Content-Length"
HeaderLength = Annotated[
    int | None,
    Header(alias=_BINARY_AFTER, ge=0, le=2**31, description="Length of the JSON before tensors."),
]


@open_router.get("/health/live", response_model=Ready, responses=problems())
async def live(request: Request) -> Response:
    """Tell that the process is alive.

    Parameters
    ----------
    request
        The request.

    Returns
    -------
    Response
        Live.
    """
    return _json({"live": True})


@open_router.get("/health/ready", response_model=Ready, responses=problems())
async def ready(request: Request) -> Response:
    """Tell that models answer.

    Parameters
    ----------
    request
        The request.

    Returns
    -------
    Response
        Ready.
    """
    await refuse_unready(request)
    return _json({"ready": True})


@router.get("", response_model=ServerMetadata, responses=problems())
async def server(request: Request) -> Response:
    """Describe the server.

    Parameters
    ----------
    request
        The request.

    Returns
    -------
    Response
        Name, version and extensions.
    """
    extensions = ["binary_tensor_data"]
    return _json({"name": "ssil-data", "version": version("ssil-data"), "extensions": extensions})


@router.get("/models/{model}", response_model=ModelMetadata, responses=problems(404, 409, 422))
@router.get(
    "/models/{model}/versions/{version}",
    response_model=ModelMetadata,
    responses=problems(404, 409, 422),
)
async def metadata(
    request: Request, model: ModelName, version: ModelVersion | None = None
) -> Response:
    """Describe the inputs and outputs of a model.

    Parameters
    ----------
    request
        The request.
    model
        Name of the model.
    version
        Fingerprint of the dataset's version that its run was made from; None for any.

    Returns
    -------
    Response
        Its metadata.
    """
    found = await find_model(context(request).catalog, model, version)
    widths = found.snapshot.widths
    inputs = [("states", "FP32", widths[0])]
    if not found.kind:
        inputs += [("actions", "FP32", widths[1])]
    shown = [{"name": n, "datatype": t, "shape": [-1, w]} for n, t, w in inputs]
    if not found.kind:
        shown += [{"name": "episode", "datatype": "INT64", "shape": [-1]}]
    outputs = _OUTPUTS[found.kind].items()
    return _json(
        {
            "name": model,
            "versions": [found.version],
            "platform": "ssil-data",
            "inputs": shown,
            "outputs": [{"name": n, "datatype": t, "shape": [-1]} for n, t in outputs],
        }
    )


@router.get("/models/{model}/ready", response_model=Ready, responses=problems(404, 409, 422))
@router.get(
    "/models/{model}/versions/{version}/ready",
    response_model=Ready,
    responses=problems(404, 409, 422),
)
async def model_ready(
    request: Request, model: ModelName, version: ModelVersion | None = None
) -> Response:
    """Tell that a model answers.

    Parameters
    ----------
    request
        The request.
    model
        Name of the model.
    version
        Fingerprint of the dataset's version that its run was made from; None for any.

    Returns
    -------
    Response
        Ready.
    """
    await find_model(context(request).catalog, model, version)
    return _json({"name": model, "ready": True})


_INFER: dict[str, Any] = {
    "response_model": InferenceAnswer,
    "responses": problems(404, 408, 409, 413, 415, 422),
    "openapi_extra": json_body(InferenceRequest),
}


@router.post("/models/{model}/infer", **_INFER)
@router.post("/models/{model}/versions/{version}/infer", **_INFER)
async def infer(
    request: Request,
    model: ModelName,
    version: ModelVersion | None = None,
    length: HeaderLength = None,
) -> Response:
    """Query a model; tensors are JSON, or binary after the JSON (the protocol's extension).

    Parameters
    ----------
    request
        The request.
    model
        Name of the model.
    version
        Fingerprint of the dataset's version that its run was made from; None for any.
    length
        Length of the JSON if binary tensors follow it.

    Returns
    -------
    Response
        The outputs.
    """
    offered = (JSON, "application/octet-stream") if length is not None else (JSON,)
    media_type(request, offered, unnamed=JSON)  # as Triton's own client sends it
    here = context(request)
    found = await find_model(here.catalog, model, version)
    body = await request.body()
    most_json = here.settings.json_bytes
    query, inputs = await here.convert(
        len(body), lambda: tensors.read(body, length, most_json=most_json), JSON
    )
    unknown = {output.name for output in query.outputs} - set(_OUTPUTS[found.kind])
    if unknown:
        known = ", ".join(sorted(_OUTPUTS[found.kind]))
        raise Problem(422, f"outputs: this model has {known} and no others")
    outputs = await _outputs(here, found, inputs)
    here.metrics.record_rows("infer", len(next(iter(outputs.values()))))
    about = {"model_name": model, "model_version": found.version, "id": query.id}
    size = sum(values.nbytes for values in outputs.values())
    answer, header = await here.convert(size, lambda: tensors.write(query, about, outputs), JSON)
    if header is None:
        return Response(answer, media_type=JSON)
    return Response(
        answer, media_type="application/octet-stream", headers={_BINARY_AFTER: str(header)}
    )


async def _outputs(here: Context, model: Model, inputs: dict[str, np.ndarray]) -> dict[str, Any]:
    known = ("states",) if model.kind else ("states", "actions", "episode")
    missing = {"states"} | ({"actions"} if not model.kind else set())
    if not missing <= set(inputs) <= set(known):
        needed = "states" if model.kind else "states and actions; episode is optional"
        raise Problem(422, f"inputs: this model needs {needed}")
    states = _rows(inputs, "states", model.snapshot.widths[0])
    most = here.settings.query_rows
    if len(states) > most:
        raise Problem(413, f"states: expected at most {most} rows, found {len(states)}")
    if not model.kind:
        return await _score(here, model, inputs, states)
    field = await here.catalog.field(model.snapshot, model.run, None)
    if model.kind == "cor":
        return {"values": await here.compute(COR_COST * len(states), lambda: field.cor(states))}
    size = len(states) * len(field.states)
    answer = await here.compute(size, lambda: field.lcor(states))
    return {"values": answer.values, "effective_sample_size": answer.effective_sample_size}


async def _score(
    here: Context, model: Model, inputs: dict[str, np.ndarray], states: Any
) -> dict[str, Any]:
    actions = _rows(inputs, "actions", model.snapshot.widths[1])
    episode = inputs.get("episode", np.zeros(len(states), np.int64))
    if episode.dtype != np.int64 or episode.ndim != 1:
        raise Problem(422, "episode: the tensor must be INT64 of one dimension")
    pairs = Pairs(states, actions, episode, number_steps(episode))
    estimator = await here.catalog.model(model.snapshot, model.run)
    scored = await here.compute(SCORE_COST * len(pairs), lambda: estimator(pairs))
    return {name: getattr(scored, name) for name in _OUTPUTS[""]}


def _rows(inputs: dict[str, np.ndarray], name: str, width: int) -> Any:
    values = inputs[name]
    if values.ndim != 2 or values.shape[1] != width:
        raise Problem(422, f"{name}: expected shape [n, {width}], found {list(values.shape)}")
    return check_float32(name, values, width)


def _json(value: Any) -> Response:
    return Response(to_json(value), media_type=JSON)
