"""Overload: what is too much at once is refused at once, with a time to retry after."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any

import httpx
import pytest
from fastapi import FastAPI, Request
from starlette.responses import Response

from ssil_service import embed
from ssil_service.http.middleware import Middleware
from ssil_service.metrics import Metrics
from ssil_service.problems import Problem
from ssil_service.queries.admission import BoundedExecutor
from ssil_service.server.embedded import EmbeddedTransport
from ssil_service.settings import Settings
from ssil_service.workers.decoding import Decoder
from ssil_service.workers.lease import ServerLease


def test_a_full_executor_refuses_at_once_with_a_time_to_retry_after():
    async def overload() -> list[BaseException | None]:
        executor = BoundedExecutor(computing=1, waiting=2)
        tasks = [asyncio.ensure_future(executor.run(lambda: time.sleep(0.05))) for _ in range(6)]
        done = await asyncio.gather(*tasks, return_exceptions=True)
        executor.close(1)
        return done

    done = asyncio.run(overload())
    refused = [each for each in done if isinstance(each, Problem)]
    assert len(refused) == 3
    assert {each.status for each in refused} == {503}
    assert int(refused[0].headers["Retry-After"]) >= 1


@pytest.fixture
def slow() -> Iterator[tuple[Callable[..., httpx.Client], Event]]:
    """Start services whose `/slow` answers once an event is set, with as many bytes as it got."""
    answer = Event()
    clients: list[httpx.Client] = []
    app = FastAPI()
    metrics = Metrics()

    @app.exception_handler(Problem)
    async def refuse(request: Request, problem: Any) -> Response:
        return problem.response()

    @app.get("/healthz")
    @app.post("/slow")
    async def slow(request: Request) -> Response:
        body = await request.body()
        async with asyncio.timeout(10):
            while not answer.is_set() and request.method == "POST":
                await asyncio.sleep(0.01)
        return Response(b"x" * len(body))

    @app.get("/long")
    @app.post("/lcor")
    @app.put("/lcor")
    @app.post("/change")
    async def long() -> Response:
        return Response(b"x" * 200_000)

    @app.get("/metrics")
    async def show_metrics() -> Response:
        return Response(metrics.text())

    def start(**settings: Any) -> httpx.Client:
        service = Middleware(app, settings=Settings(**settings), metrics=metrics)
        clients.append(httpx.Client(transport=EmbeddedTransport(service), base_url="http://here"))
        return clients[-1]

    yield start, answer
    answer.set()
    for client in clients:
        client.close()


def test_too_many_requests_at_once_are_refused_but_health_checks_are_answered(slow):
    start, answer = slow
    http = start(requests=1)
    with ThreadPoolExecutor(1) as other:
        first = other.submit(http.post, "/slow")
        while http.get("/slow").status_code == 405:  # the first one has not arrived yet
            time.sleep(0.01)
        refused = http.get("/slow")
        assert (refused.status_code, refused.headers["retry-after"]) == (503, "1")
        assert refused.json()["detail"] == "Too many concurrent requests (limit 1); retry after 1 s"
        assert http.get("/healthz").status_code == 200
        answer.set()
        assert first.result().status_code == 200
    assert http.get("/slow").status_code == 405


@pytest.fixture
def full(slow: Any) -> Iterator[httpx.Client]:
    """Start a service whose memory budget is used up by one request."""
    start, answer = slow
    http = start(held_bytes=10_000)
    with ThreadPoolExecutor(1) as other:
        first = other.submit(
            http.post, "/slow", content=b"x" * 19_000
        )  # the only one may exceed the budget
        while "ssil_held_bytes 19000.0" not in http.get("/metrics").text:
            time.sleep(0.01)
        yield http
        answer.set()
        assert first.result().content == b"x" * 19_000
    assert http.post("/slow", content=b"x" * 2000).status_code == 200


def test_a_body_beyond_the_memory_budget_is_refused(full: httpx.Client):
    refused = full.post("/slow", content=b"x" * 2000)
    assert (refused.status_code, refused.headers["retry-after"]) == (503, "1")
    assert refused.headers["content-type"] == "application/problem+json"


def test_a_long_answer_to_a_query_beyond_the_memory_budget_is_refused(full: httpx.Client):
    for refused in (full.get("/long"), full.post("/lcor")):
        assert (refused.status_code, refused.headers["retry-after"]) == (503, "1")
    assert full.get("/healthz").status_code == 200  # a short answer needs no budget


def test_a_committed_change_is_acknowledged_even_under_memory_pressure(full: httpx.Client):
    """After a 503 the client would repeat it."""
    assert full.post("/change").status_code == 200
    assert full.put("/lcor").status_code == 200


def test_the_only_request_may_exceed_the_memory_budget(slow):
    start, _ = slow
    assert len(start(held_bytes=10_000).get("/long").content) == 200_000


@pytest.mark.parametrize(
    ("method", "path", "received", "retry_after"),
    [
        ("POST", "/v1/datasets/a/runs/b/lcor", True, "1"),
        ("GET", "/v1/datasets", True, "1"),
        ("POST", "/v1/datasets/a/episodes", False, "1"),
        ("POST", "/v1/datasets/a/episodes", True, None),
        ("PUT", "/v1/datasets/lcor", True, None),
        ("DELETE", "/v1/datasets/episodes", False, None),
        ("POST", "/v1/datasets/a/runs", True, None),
    ],
)
def test_a_request_cut_off_by_shutdown_may_be_retried_only_if_nothing_was_changed(
    method: str, path: str, received: bool, retry_after: str | None
):
    """Retry-After on a 503 says that nothing was begun, so that even a change may be repeated."""
    sent: list[Any] = []
    begun = asyncio.Event()

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await receive()
        begun.set()
        await asyncio.sleep(10)

    async def receive() -> Any:
        return {"type": "http.request", "body": b"x", "more_body": not received}

    async def send(message: Any) -> None:
        sent.append(message)

    async def end() -> None:
        closing: Any = SimpleNamespace(closing=True)
        scope = {"type": "http", "method": method, "path": path, "headers": []}
        service = Middleware(app, settings=Settings(), metrics=Metrics(), context=lambda: closing)
        request = asyncio.ensure_future(service(scope, receive, send))
        await begun.wait()
        request.cancel()
        await asyncio.wait([request])

    asyncio.run(end())
    assert sent[0]["status"] == 503
    found = dict(sent[0]["headers"]).get(b"retry-after")
    assert (found and found.decode()) == retry_after


def test_event_streams_have_a_limit_of_their_own(folder: Path):
    with embed(folder, requests=1, event_streams=1) as store:
        http = store.connection.client
        body = {"estimator": {"kind": "vae", "steps": 3000}}
        job = http.post("v1/datasets/drives/runs", json=body).json()["job"]
        with http.stream("GET", f"v1/jobs/{job}/events") as events:
            next(events.iter_lines())
            assert http.get("v1/datasets").status_code == 200
            second = http.get(f"v1/jobs/{job}/events")
            assert (second.status_code, second.headers["retry-after"]) == (503, "1")
            assert second.json()["detail"].startswith("Too many event streams (limit 1)")
            http.post(f"v1/jobs/{job}/cancel")


def test_uploads_are_admitted_before_their_bodies_are_received(tmp_path: Path):
    lease = ServerLease(tmp_path)
    received = Event()

    async def endless() -> AsyncIterator[bytes]:
        while not received.is_set():
            yield b"x"
            await asyncio.sleep(0.01)

    async def never() -> AsyncIterator[bytes]:
        raise AssertionError("the body was read")
        yield b""

    async def crowd() -> None:
        pool: Any = None
        decoder = Decoder(lease, pool, query_rows=1, upload_rows=1)
        admitted = [asyncio.ensure_future(decoder.upload(endless())) for _ in range(18)]
        await asyncio.sleep(0.1)
        with pytest.raises(Problem) as refusal:
            await decoder.upload(never())
        assert (refusal.value.status, refusal.value.headers["Retry-After"]) == (503, "2")
        for each in admitted:
            each.cancel()
        await asyncio.gather(*admitted, return_exceptions=True)

    asyncio.run(crowd())
    assert [path.name for path in lease.folder.iterdir()] == ["lock"]
    lease.close()
