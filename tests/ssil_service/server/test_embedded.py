"""The service without a socket: closed at any moment, it leaves no thread waiting."""

import asyncio
import threading
import time
from pathlib import Path

import httpx
import pytest
from starlette.types import Receive, Scope, Send

import ssil_data as sd
from ssil_data.client import connect
from ssil_service import embed
from ssil_service.server.embedded import EmbeddedTransport

REQUEST = httpx.Request("GET", "http://embedded/v1/datasets")


async def stuck(scope: Scope, receive: Receive, send: Send) -> None:
    """Start and stop, and finish no answer: only `/half` begins one."""
    if scope["type"] == "lifespan":
        await receive()
        await send({"type": "lifespan.startup.complete"})
        await receive()
        return
    if scope["path"] == "/half":
        headers = [(b"content-length", b"8")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": b"half", "more_body": True})
    await asyncio.Event().wait()


@pytest.mark.parametrize("path", ["half", "nothing"])
def test_closing_ends_requests_in_flight_with_an_error(path: str):
    transport = EmbeddedTransport(stuck)
    found: list[BaseException] = []

    def ask() -> None:
        try:
            transport.handle_request(httpx.Request("GET", f"http://embedded/{path}")).read()
        except httpx.RemoteProtocolError as error:
            found.append(error)

    threads = [threading.Thread(target=ask, daemon=True) for _ in range(3)]
    for thread in threads:
        thread.start()
    time.sleep(0.1)
    transport.close()
    for thread in threads:
        thread.join(10)
    assert [str(error) for error in found] == [
        "the embedded service was closed before it answered"
    ] * 3


def test_a_request_after_closing_is_refused_at_once():
    transport = EmbeddedTransport(stuck)
    transport.close()
    transport.close()
    with pytest.raises(sd.ServiceError, match="The embedded service is closed"):
        transport.handle_request(REQUEST)


def test_a_response_that_the_application_breaks_off_is_an_error():
    async def broken(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            return await stuck(scope, receive, send)
        await send({"type": "http.response.start", "status": 200})
        await send({"type": "http.response.body", "body": b"half", "more_body": True})
        raise ValueError("found odd")

    transport = EmbeddedTransport(broken)
    odd = pytest.raises(httpx.RemoteProtocolError, match="found odd")
    with connect("http://embedded", transport=transport) as store, odd:
        store.connection.client.get("anything")


def test_the_transport_ends_although_the_application_fails_at_shutdown():
    async def odd(scope: Scope, receive: Receive, send: Send) -> None:
        await stuck(scope, receive, send)
        raise ValueError("at the end")

    transport = EmbeddedTransport(odd)
    with pytest.raises(ValueError, match="at the end"):
        transport.close()
    assert not transport.running


def test_closing_a_store_under_load_leaves_no_thread_waiting(folder: Path):
    """Answers come from threads and from worker processes, and some wait for others."""
    for moment in (0.0, 0.05, 0.2):
        store = embed(folder, jobs=1, computing=1, grace_seconds=1)
        dataset = store["drives"]
        field = dataset.field("vae")
        pairs = dataset.pairs()
        found: list[BaseException] = []

        def ask(work, found=found) -> None:
            try:
                while True:
                    work()
            except sd.SsilDataError as error:
                found.append(error)

        works = [
            dataset.pairs,
            lambda field=field, pairs=pairs: field.lcor(pairs.states.repeat(20, axis=0)),
            lambda store=store: store["drives"].leverage("vae"),
            lambda dataset=dataset: dataset.score(sd.VAE(steps=1)),
        ]
        threads = [threading.Thread(target=ask, args=(w,), daemon=True) for w in works * 2]
        for thread in threads:
            thread.start()
        time.sleep(moment)
        store.close()
        for thread in threads:
            thread.join(15)
        assert len(found) == len(threads)
