"""Cached routes give the same answers and the same refusals as the router, and are really hit."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

import ssil_data as sd
from ssil_service import create_app
from ssil_service.http.route_cache import RouteCache
from ssil_service.server.embedded import EmbeddedTransport
from ssil_service.settings import Settings

LCOR = "v1/datasets/drives/runs/vae/lcor"
BODY = {"states": [[1.0, 2.0, 3.0]]}
READ_KEY = "reads-and-asks-only"
OTHER_KEY = "writes-and-deletes-too"
Service = tuple[httpx.Client, RouteCache]


@pytest.fixture
def start(folder: Path) -> Iterator[Callable[..., Service]]:
    """Start services in this process; each comes with the cache that its requests pass."""
    clients: list[httpx.Client] = []

    def start(**settings: Any) -> Service:
        service = create_app(Settings(store=str(folder), jobs=1, **settings), hosts=["here"])
        assert isinstance(service.app, RouteCache)
        transport = EmbeddedTransport(service)
        clients.append(httpx.Client(transport=transport, base_url="http://here"))
        return clients[-1], service.app

    yield start
    for client in clients:
        client.close()


@pytest.mark.parametrize("path", ["lcor?contributors=2", "lcor?alpha=3&sums=true", "cor", "score"])
def test_the_second_answer_comes_from_the_cached_route_and_equals_the_first(
    path: str, start: Callable[..., Service]
):
    http, cache = start()
    body = {**BODY, "actions": [[1.0, 2.0]]} if path == "score" else BODY
    url = f"v1/datasets/drives/runs/vae/{path}"
    first = http.post(url, json=body)
    assert (first.status_code, cache.hits) == (200, 0)
    second = http.post(url, json=body)
    assert (second.status_code, cache.hits) == (200, 1)
    assert first.content == second.content


@pytest.mark.parametrize("path", ["lcor?contributors=2", "lcor?alpha=3&sums=true"])
def test_other_parameters_are_another_entry_of_the_cache(path: str, start: Callable[..., Service]):
    http, cache = start()
    url = f"v1/datasets/drives/runs/vae/{path}"
    first = http.post(url, json=BODY)
    other = http.post(url.replace("=2", "=1").replace("=3", "=4"), json=BODY)
    assert (other.status_code, cache.hits) == (200, 0)
    assert other.content != first.content


def test_a_cached_route_reads_every_body(start: Callable[..., Service]):
    http, cache = start()
    first = http.post(LCOR, json=BODY)
    other = http.post(LCOR, json={"states": [[10.0, 100.0, 0.0]]})
    assert cache.hits == 1
    assert other.status_code == 200
    assert other.content != first.content


def test_refusals_of_a_cached_route_are_those_of_the_router(
    start: Callable[..., Service], local: sd.Store
):
    http, cache = start()

    def refuse(**request: Any) -> tuple[int, str]:
        answer = http.post(LCOR, **request)
        assert answer.headers["content-type"] == "application/problem+json"
        return answer.status_code, answer.text

    mistakes: list[dict[str, Any]] = [
        {"json": {"states": [[1, 2]]}},
        {"content": b"x", "headers": {"Content-Type": "text/csv"}},
        {"json": BODY, "headers": {"Accept": "text/csv"}},
    ]
    before = [refuse(**each) for each in mistakes]
    assert http.post(LCOR, json=BODY).status_code == 200
    assert cache.hits == 0  # no refusal was cached
    assert [refuse(**each) for each in mistakes] == before
    assert [status for status, _ in before] == [422, 415, 406]
    assert cache.hits == len(mistakes)
    local["drives"].append([sd.Episode([[1.0, 2, 3]], [[0.0, 1]])])
    status, text = refuse(json=BODY)
    assert status == 409 and str(local.folder.uri) not in text
    http.delete("v1/datasets/drives")
    assert refuse(json=BODY)[0] == 404
    assert cache.hits == len(mistakes) + 2


def test_a_cached_route_is_closed_to_other_keys(start: Callable[..., Service]):
    http, cache = start(read_key=READ_KEY, write_key=OTHER_KEY)

    def status(headers: dict[str, str]) -> int:
        return http.post(LCOR, json=BODY, headers=headers).status_code

    right = {"X-API-Key": READ_KEY}
    assert [status(right) for _ in range(3)] == [200] * 3
    assert cache.hits == 2
    assert status({}) == 401
    assert status({"X-API-Key": READ_KEY + "x"}) == 401
    assert status({"Authorization": READ_KEY}) == 401
    assert status({**right, "Authorization": "Bearer wrong"}) == 401
    assert status({"Authorization": f"Bearer {OTHER_KEY}"}) == 200
    assert cache.hits == 2


def test_metrics_name_the_route_of_cached_answers_too(start: Callable[..., Service]):
    http, cache = start()
    for _ in range(3):
        http.post(LCOR, json=BODY)
    assert cache.hits == 2
    route = 'route="/v1/datasets/{dataset}/runs/{run}/lcor"'
    line = f'ssil_request_seconds_count{{method="POST",{route},status="200"}} 3.0'
    assert line in http.get("metrics").text


def test_the_oldest_of_too_many_routes_is_dropped(
    start: Callable[..., Service], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("ssil_service.http.route_cache._CACHE_SIZE", 2)
    http, cache = start()
    for alpha in (1, 2, 3, 3, 1):
        assert http.post(f"{LCOR}?alpha={alpha}", json=BODY).status_code == 200
    assert cache.hits == 1
