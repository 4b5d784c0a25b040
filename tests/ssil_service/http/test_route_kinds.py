"""The table of route kinds against the OpenAPI document: a route that is missing in it fails."""

from pathlib import Path
from typing import Any

import pytest

from ssil_service import create_app
from ssil_service.http.route_kinds import RouteKind
from ssil_service.settings import Settings

KEY = "writes-and-deletes-too"
PARAMETERS = {"{dataset}": "drives", "{run}": "vae", "{job}": "0" * 16, "{version}": "1" * 16}


@pytest.fixture(scope="module")
def operations(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], dict[str, Any]]:
    """All operations of the document of a service with keys, by method and path."""
    folder: Path = tmp_path_factory.mktemp("store")
    app: Any = create_app(Settings(store=str(folder), write_key=KEY))  # pyright: ignore
    document = app.app.app.openapi()
    return {
        (method.upper(), path): operation
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    }


def kind_of(method: str, path: str) -> RouteKind:
    for parameter, value in {**PARAMETERS, "{model}": "drives.vae"}.items():
        path = path.replace(parameter, value)
    assert "{" not in path
    return RouteKind.of(method, path)


def test_a_route_is_read_only_if_a_read_key_opens_it(operations: Any):
    assert len(operations) > 20
    for (method, path), operation in operations.items():
        needs_write_key = "403" in operation["responses"]
        assert kind_of(method, path).read_only == (not needs_write_key), (method, path)


def test_uploads_are_the_routes_whose_body_is_a_table_and_that_change_something(operations: Any):
    uploads = {where for where in operations if kind_of(*where).upload}
    assert uploads == {
        (method, path)
        for (method, path), operation in operations.items()
        if "application/vnd.apache.parquet" in operation.get("requestBody", {}).get("content", {})
        and not kind_of(method, path).read_only
    }
    assert len(uploads) == 2


def test_event_streams_are_the_routes_that_answer_with_events(operations: Any):
    streams = {where for where in operations if kind_of(*where).event_stream}
    assert streams == {
        where
        for where, operation in operations.items()
        if "text/event-stream" in operation["responses"].get("200", {}).get("content", {})
    }
    assert len(streams) == 1


def test_health_checks_are_the_routes_that_need_no_key(operations: Any):
    checks = {where for where in operations if kind_of(*where).health_check}
    assert checks == {
        where for where, operation in operations.items() if "401" not in operation["responses"]
    }
    assert len(checks) == 4


@pytest.mark.parametrize("path", ["/v1/jobs/a/b/events", "/v1/jobs/events", "/v1/jobs/a/events/x"])
def test_what_only_looks_like_an_event_stream_is_none(path: str):
    assert not RouteKind.of("GET", path).event_stream


@pytest.mark.parametrize("name", ["lcor", "episodes", "healthz"])
def test_a_dataset_may_be_named_like_a_route(name: str):
    kind = RouteKind.of("PUT", f"/v1/datasets/{name}")
    assert kind == RouteKind(read_only=False, upload=True, event_stream=False, health_check=False)
