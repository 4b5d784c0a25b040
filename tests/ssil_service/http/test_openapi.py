"""The OpenAPI document names the answers that clients get from the middleware too."""

from pathlib import Path
from typing import Any

import httpx
import pytest

from ssil_service import embed

LCOR = "/v1/datasets/{dataset}/runs/{run}/lcor"
MODEL = "/v2/models/{model}"
LOCAL = {"Host": "localhost"}
FOREIGN = {"Host": "localhost", "Origin": "https://elsewhere.example"}
LARGE = {"Content-Length": "999999999"}


@pytest.mark.parametrize(
    ("method", "path", "headers", "status"),
    [
        ("GET", "/v1/limits", LARGE, 413),
        ("GET", "/healthz", LARGE, 413),
        ("POST", LCOR, FOREIGN, 403),
        ("POST", f"{MODEL}/infer", FOREIGN, 403),
        ("DELETE", "/v1/datasets/{dataset}", LOCAL | {"If-Match": '"other"'}, 412),
    ],
)
def test_the_answers_of_the_middleware_are_documented(
    method: str, path: str, headers: dict[str, str], status: int, shared_http: httpx.Client
):
    url = path.format(dataset="drives", run="vae", model="drives.vae")
    assert shared_http.request(method, url, headers=headers).status_code == status
    assert str(status) in documented(shared_http)["paths"][path][method.lower()]["responses"]


def test_other_methods_and_head_are_documented(shared_http: httpx.Client):
    text = documented(shared_http)["info"]["description"]
    assert "HEAD is answered" in text and "405" in text and "Retry-After" in text


def test_with_keys_another_origin_may_query_and_the_document_says_so(folder: Path):
    with embed(folder, read_key="reads-and-asks-only") as store:
        http = store.connection.client
        headers = FOREIGN | {"X-API-Key": "reads-and-asks-only"}
        path = LCOR.format(dataset="drives", run="vae")
        assert http.post(path, headers=headers, json={"states": [[1, 2, 3]]}).status_code == 200
        assert "403" not in documented(http)["paths"][LCOR]["post"]["responses"]


def test_starting_a_run_ignores_the_accept_header(shared_http: httpx.Client):
    path = "/v1/datasets/{dataset}/runs"
    assert "406" not in documented(shared_http)["paths"][path]["post"]["responses"]


def documented(http: httpx.Client) -> dict[str, Any]:
    return http.get("openapi.json", headers={"Accept": "application/json"}).json()
