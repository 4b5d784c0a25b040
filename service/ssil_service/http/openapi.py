"""The OpenAPI document: FastAPI's, with tables as bodies and answers and with every error."""

from __future__ import annotations

from functools import lru_cache
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic import BaseModel
from pydantic.json_schema import models_json_schema
from starlette.routing import compile_path

from ssil_data.client.wire import ARROW, JSON, PARQUET
from ssil_service.http.route_kinds import RouteKind
from ssil_service.problems import PROBLEM, ProblemDetails
from ssil_service.schemas import inference, requests, responses
from ssil_service.settings import Settings

_REFERENCE = "#/components/schemas/{model}"
_BINARY = {"type": "string", "format": "binary"}
_MODELS: tuple[type[BaseModel], ...] = (
    ProblemDetails,
    requests.StatesBody,
    requests.PairsBody,
    requests.FitBody,
    requests.RescoreBody,
    responses.LCoRAnswer,
    responses.SumsAnswer,
    responses.CoRAnswer,
    responses.ScoreAnswer,
    responses.EpisodesPage,
    responses.PairsPage,
    responses.LeveragePage,
    inference.InferenceRequest,
    inference.InferenceAnswer,
)
_ALWAYS = (421, 422, 500, 503)
"""421 without keys, for a foreign Host; 422 at least for parameters that are unknown."""
_RETRY = {"Retry-After": {"description": "Seconds to wait.", "schema": {"type": "integer"}}}
_PAGED = {
    "X-Total-Count": {"description": "Rows on all pages.", "schema": {"type": "integer"}},
    "Link": {"description": "The next page, if there is one.", "schema": {"type": "string"}},
}
_EVERYWHERE = """HEAD is answered where GET is, but for events; other methods get 405 with `Allow`.

A 503 with `Retry-After` means that nothing was begun: even a change may be repeated.

Limits of this service, also at `/v1/limits`:"""
_TAGGED = {"ETag": {"description": "For `If-None-Match`.", "schema": {"type": "string"}}}


def problems(*statuses: int, tagged: bool = False) -> dict[int | str, dict[str, Any]]:
    """Return the errors that a route may answer with.

    Parameters
    ----------
    *statuses
        Statuses beside those that every route may answer with.
    tagged
        Whether the route gives ETags, and so may answer 304.

    Returns
    -------
    dict
        For `responses`.
    """
    found: dict[int | str, dict[str, Any]] = {
        status: {
            "description": HTTPStatus(status).phrase,
            "content": {PROBLEM: {"schema": _reference(ProblemDetails)}},
            **({"headers": _RETRY} if status in (429, 503) else {}),
        }
        for status in (*statuses, *_ALWAYS)
    }
    return {**found, 304: {"description": "Not Modified", "headers": _TAGGED}} if tagged else found


def bulk(*models: type[BaseModel], paged: bool = False) -> dict[str, Any]:
    """Return the answer of a route that sends a table: JSON columns, Arrow or Parquet.

    Parameters
    ----------
    *models
        The JSON form; any one of several.
    paged
        Whether the answer has pages.

    Returns
    -------
    dict
        For one status of `responses`.
    """
    content: dict[str, Any] = {JSON: {"schema": _any_of(*models)}}
    content |= {ARROW: {"schema": _BINARY}, PARQUET: {"schema": _BINARY}}
    headers = {**_TAGGED, **_PAGED} if paged else {}
    return {"description": "Successful Response", "content": content, "headers": headers}


def bulk_body(*models: type[BaseModel]) -> dict[str, Any]:
    """Return the body of a query: JSON, Arrow or Parquet.

    Parameters
    ----------
    *models
        The JSON form; any one of several.

    Returns
    -------
    dict
        For `openapi_extra`.
    """
    return _body({JSON: _any_of(*models), ARROW: _BINARY, PARQUET: _BINARY})


def json_body(*models: type[BaseModel]) -> dict[str, Any]:
    """Return a body that is JSON only.

    Parameters
    ----------
    *models
        The JSON form; any one of several.

    Returns
    -------
    dict
        For `openapi_extra`.
    """
    return _body({JSON: _any_of(*models)})


def events(model: type[BaseModel]) -> dict[str, Any]:
    """Return the answer that is a stream of server-sent events.

    Parameters
    ----------
    model
        The JSON form of an event's data.

    Returns
    -------
    dict
        For one status of `responses`.
    """
    known = {"event": {"type": "string"}, "data": {"type": "string"}}
    schema = {"type": "object", "properties": known, "description": f"data: a {model.__name__}"}
    return {"description": "Events", "content": {"text/event-stream": {"schema": schema}}}


def upload_body() -> dict[str, Any]:
    """Return the body of an upload: Arrow or Parquet."""
    return _body({ARROW: _BINARY, PARQUET: _BINARY})


def build_document(app: FastAPI, settings: Settings, *, local_only: bool) -> dict[str, Any]:
    """Build the OpenAPI document of an application, once.

    Parameters
    ----------
    app
        With all its routes.
    settings
        Whose limits the document shows.
    local_only
        Whether there are no keys, so that requests of foreign origins are refused.

    Returns
    -------
    dict
        The document; the same object every time.
    """
    if not app.openapi_schema:
        document = get_openapi(
            title=app.title,
            version=app.version,
            summary=app.summary,
            description=_description(settings),
            routes=app.routes,
        )
        _, components = models_json_schema(
            [(model, "validation") for model in _MODELS], ref_template=_REFERENCE
        )
        known = document.setdefault("components", {}).setdefault("schemas", {})
        known |= components["$defs"]
        _forget_null(document)
        _shorten_descriptions(document)
        _add_middleware_answers(document, foreign=local_only)
        for unused in ("HTTPValidationError", "ValidationError"):
            known.pop(unused, None)
        app.openapi_schema = document
    return app.openapi_schema


def _add_middleware_answers(document: dict[str, Any], *, foreign: bool) -> None:
    """Add the errors of the middleware, which answers before any route.

    413 for a body whose announced length is too large; without keys, 403 for a change from a
    foreign origin; 507 where something may be written and the disk is full.
    """
    for path in document["paths"].values():
        for method, operation in path.items():
            statuses = [413] if method == "get" else [413, 507, *([403] if foreign else [])]
            for status in statuses:
                operation["responses"].setdefault(str(status), problems(status)[status])


def _forget_null(document: dict[str, Any]) -> None:
    """Remove null from the types of parameters: one that is not given is absent, not "null"."""
    operations = [each for path in document["paths"].values() for each in path.values()]
    for operation in operations:
        for parameter in operation.get("parameters", []):
            schema = parameter["schema"]
            kinds = [kind for kind in schema.pop("anyOf", []) if kind != {"type": "null"}]
            schema |= kinds[0] if kinds else {}


def _shorten_descriptions(document: dict[str, Any]) -> None:
    """End each description before the section on the Python function's parameters."""
    for path in document["paths"].values():
        for operation in path.values():
            text = operation.get("description", "")
            operation["description"] = text.partition("\n\nParameters\n")[0]


def find_methods(app: FastAPI, path: str) -> list[str]:
    """Return the methods that a path answers.

    Parameters
    ----------
    app
        The application.
    path
        Path of a request.

    Returns
    -------
    list of str
        In alphabetical order; empty for an unknown path.
    """
    found = {kind for pattern, kinds in _patterns(app) if pattern.match(path) for kind in kinds}
    follows = RouteKind.of("GET", path).event_stream
    return sorted(found | ({"HEAD"} if "GET" in found and not follows else set()))


@lru_cache(8)
def _patterns(app: FastAPI) -> list[tuple[Any, list[str]]]:
    return [
        (compile_path(path)[0], [method.upper() for method in operations])
        for path, operations in app.openapi()["paths"].items()
    ]


def _description(settings: Settings) -> str:
    limits = [
        f"- `{name}` {getattr(settings, name):,}"
        for name in responses.Limits.model_fields
        if hasattr(settings, name)
    ]
    return "\n".join([_EVERYWHERE, "", *limits])


def _any_of(*models: type[BaseModel]) -> dict[str, Any]:
    references = [_reference(model) for model in models]
    return references[0] if len(references) == 1 else {"anyOf": references}


def _reference(model: type[BaseModel]) -> dict[str, str]:
    return {"$ref": _REFERENCE.format(model=model.__name__)}


def _body(content: dict[str, Any]) -> dict[str, Any]:
    kinds = {media: {"schema": schema} for media, schema in content.items()}
    return {"requestBody": {"required": True, "content": kinds}}
