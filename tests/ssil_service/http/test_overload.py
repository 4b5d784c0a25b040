"""Overload: what is too much at once is refused at once, with a time to come back."""

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


def test_a_full_gate_refuses_at_once_with_a_time_to_wait():
    async def overload() -> list[BaseException | None]:
        gate = BoundedExecutor(computing=1, waiting=2)
        tasks = [asyncio.ensure_future(gate.run(lambda: time.sleep(0.05))) for _ in range(6)]
        done = await asyncio.gather(*tasks, return_exceptions=True)
        gate.close(1)
        return done

    done = asyncio.run(overload())
    refused = [each for each in done if isinstance(each, Problem)]
    assert len(refused) == 3
    assert {each.status for each in refused} == {503}
    assert int(refused[0].headers["Retry-After"]) >= 1


@pytest.fixture
def slow() -> Iterator[tuple[Callable[..., httpx.Client], Event]]:
    """Make services that answer when they are told to, with as many bytes as they were sent."""
    told, made = Event(), list[httpx.Client]()
    app, metrics = FastAPI(), Metrics()

    @app.exception_handler(Problem)
    async def refused(request: Request, problem: Any) -> Response:
        return problem.response()

    @app.get("/healthz")
    @app.post("/slow")
    async def slow(request: Request) -> Response:
        body = await request.body()
        async with asyncio.timeout(10):
            while not told.is_set() and request.method == "POST":
                await asyncio.sleep(0.01)
        return Response(b"x" * len(body))

    @app.get("/long")
    @app.post("/lcor")
    @app.put("/lcor")
    @app.post("/written")
    async def long() -> Response:
        return Response(b"x" * 200_000)

    @app.get("/metrics")
    async def told_metrics() -> Response:
        return Response(metrics.text())

    def start(**settings: Any) -> httpx.Client:
        service = Middleware(app, settings=Settings(**settings), metrics=metrics)
        made.append(httpx.Client(transport=EmbeddedTransport(service), base_url="http://here"))
        return made[-1]

    yield start, told
    told.set()
    for client in made:
        client.close()


def test_too_many_requests_at_once_are_refused_but_health_is_told(slow):
    start, told = slow
    http = start(requests=1)
    with ThreadPoolExecutor(1) as other:
        first = other.submit(http.post, "/slow")
        while http.get("/slow").status_code == 405:  # that one is there yet
            time.sleep(0.01)
        refused = http.get("/slow")
        assert (refused.status_code, refused.headers["retry-after"]) == (503, "1")
        assert http.get("/healthz").status_code == 200
        told.set()
        assert first.result().status_code == 200
    assert http.get("/slow").status_code == 405


@pytest.fixture
def full(slow: Any) -> Iterator[httpx.Client]:
    """Make a service that holds as much as it may, and more than it may with anything else."""
    start, told = slow
    http = start(held_bytes=10_000)
    with ThreadPoolExecutor(1) as other:
        first = other.submit(http.post, "/slow", content=b"x" * 19_000)  # alone, it may
        while "ssil_held_bytes 19000.0" not in http.get("/metrics").text:
            time.sleep(0.01)
        yield http
        told.set()
        assert first.result().content == b"x" * 19_000
    assert http.post("/slow", content=b"x" * 2000).status_code == 200


def test_bodies_are_held_within_a_bound(full: httpx.Client):
    refused = full.post("/slow", content=b"x" * 2000)
    assert (refused.status_code, refused.headers["retry-after"]) == (503, "1")
    assert refused.headers["content-type"] == "application/problem+json"


def test_long_answers_to_questions_are_held_within_a_bound(full: httpx.Client):
    for answer in (full.get("/long"), full.post("/lcor")):
        assert (answer.status_code, answer.headers["retry-after"]) == (503, "1")
    assert full.get("/healthz").status_code == 200  # a short answer is not worth a refusal


def test_a_change_that_is_made_is_told_whatever_is_held(full: httpx.Client):
    """Told 503, the client would make it again."""
    assert full.post("/written").status_code == 200
    assert full.put("/lcor").status_code == 200


def test_a_long_answer_is_given_up_to_whoever_is_alone(slow):
    start, _ = slow
    assert len(start(held_bytes=10_000).get("/long").content) == 200_000


@pytest.mark.parametrize(
    ("method", "path", "received", "again"),
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
def test_what_may_be_made_is_not_asked_again_at_the_end(
    method: str, path: str, received: bool, again: str | None
):
    """A request that is cut off at the end of the grace has Retry-After if nothing was begun."""
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
    told = dict(sent[0]["headers"]).get(b"retry-after")
    assert (told and told.decode()) == again


def test_event_streams_have_places_of_their_own(folder: Path):
    with embed(folder, requests=1, event_streams=1) as store:
        http = store.connection.client
        body = {"estimator": {"kind": "vae", "steps": 3000}}
        job = http.post("v1/datasets/drives/runs", json=body).json()["job"]
        with http.stream("GET", f"v1/jobs/{job}/events") as events:
            next(events.iter_lines())
            assert http.get("v1/datasets").status_code == 200
            second = http.get(f"v1/jobs/{job}/events")
            assert (second.status_code, second.headers["retry-after"]) == (503, "1")
            http.post(f"v1/jobs/{job}/cancel")


def test_uploads_are_admitted_before_their_bodies_are_kept(tmp_path: Path):
    lease = ServerLease(tmp_path)
    received = Event()

    async def endless() -> AsyncIterator[bytes]:
        while not received.is_set():
            yield b"x"
            await asyncio.sleep(0.01)

    async def never() -> AsyncIterator[bytes]:
        raise AssertionError("the body was asked for")
        yield b""

    async def crowd() -> None:
        pool: Any = None
        decoder = Decoder(lease, pool, query_rows=1, upload_rows=1)
        held = [asyncio.ensure_future(decoder.upload(endless())) for _ in range(18)]
        await asyncio.sleep(0.1)
        with pytest.raises(Problem) as refusal:
            await decoder.upload(never())
        assert (refusal.value.status, refusal.value.headers["Retry-After"]) == (503, "2")
        for each in held:
            each.cancel()
        await asyncio.gather(*held, return_exceptions=True)

    asyncio.run(crowd())
    assert [path.name for path in lease.folder.iterdir()] == ["lock"]
    lease.close()
