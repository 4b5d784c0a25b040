"""Requests are sent again where that is safe, and errors are those of the library."""

import contextlib
import json
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import httpx
import pytest

import ssil_data as sd
from ssil_data.client import RetryPolicy, connect
from ssil_service import embed
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive
from support.scripted_service import BUSY, LISTED, QUICK, scripted_store


@pytest.mark.parametrize(
    "failure",
    [
        httpx.Response(503, json=BUSY),
        httpx.Response(429, json=BUSY),
        httpx.ConnectError("refused"),
        httpx.ReadError("reset"),
        httpx.RemoteProtocolError("hung up"),
    ],
)
def test_a_busy_or_lost_service_is_tried_again(failure: httpx.Response | Exception):
    store, seen = scripted_store(failure, failure, httpx.Response(200, json=LISTED))
    assert store.names() == ["drives"]
    assert len(seen) == 3
    assert seen[0].headers["authorization"] == "Bearer the key"


def test_retries_end(monkeypatch: pytest.MonkeyPatch):
    store, seen = scripted_store(*[httpx.Response(503, json=BUSY)] * 10_000)
    with pytest.raises(sd.ServiceError, match="busy"):
        store.names()
    assert len(seen) > 10


def test_the_time_that_a_busy_service_names_is_waited():
    waited = httpx.Response(503, json=BUSY, headers={"Retry-After": "0.2"})
    store, _ = scripted_store(waited, httpx.Response(200, json=LISTED))
    begin = time.monotonic()
    store.names()
    assert time.monotonic() - begin >= 0.2


def test_what_may_not_be_repeated_is_not_sent_twice():
    store, seen = scripted_store(httpx.ReadError("reset"), httpx.Response(204))
    with pytest.raises(sd.ServiceError, match="reset; the change may have been made: look before"):
        store.delete("drives")
    assert len(seen) == 1


@pytest.mark.parametrize("status", [429, 503])
def test_what_may_not_be_repeated_is_repeated_after_refusals_before_any_work_alone(status: int):
    begun = httpx.Response(status, json=BUSY, headers={"Retry-After": "0"})
    store, seen = scripted_store(begun, begun, httpx.Response(204))
    store.delete("drives")
    assert len(seen) == 3
    store, seen = scripted_store(httpx.Response(status, json=BUSY), httpx.Response(204))
    with pytest.raises(sd.ServiceError, match="busy; the change may have been made: look before"):
        store.delete("drives")
    assert len(seen) == 1


def test_an_append_whose_response_was_refused_is_made_once(local: sd.Store):
    """The service has too much to hold for the answer, after the commit."""
    with embed(local.folder.uri, jobs=1) as store:
        names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
        dataset = store.create("once", [drive(0, 5)], **names)
        client = store.connection.client
        send = client.send

        def refused(request: httpx.Request) -> httpx.Response:
            answer = send(request)
            late = httpx.Response(503, json=BUSY, request=request)
            return late if request.url.path.endswith("/episodes") else answer

        client.send = refused  # pyright: ignore[reportAttributeAccessIssue]
        with pytest.raises(sd.ServiceError, match="may have been made: look"):
            dataset.append([drive(1, 5)])
        assert len(local["once"].episodes) == 2
        store.delete("once")


def test_a_store_that_is_closed_says_so(local: sd.Store):
    store = embed(local.folder.uri, jobs=1)
    store.close()
    with pytest.raises(sd.ServiceError, match="this store is closed; connect again"):
        store.names()


class Slow(BaseHTTPRequestHandler):
    """A service that takes longer for its work than a client waits for an answer."""

    asked = 0

    def do_PUT(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        Slow.asked += 1
        time.sleep(0.6)
        self._answer({"dataset": "slow", "version": "0" * 16})

    def do_GET(self) -> None:
        time.sleep(0.6 if self.path == "/v1/datasets" else 0)
        self._answer({"query_rows": 10, "datasets": []})

    def _answer(self, found: dict[str, Any]) -> None:
        body = json.dumps(found).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        with contextlib.suppress(BrokenPipeError):
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None: ...


@pytest.fixture
def slow() -> Iterator[ThreadingHTTPServer]:
    with ThreadingHTTPServer(("127.0.0.1", 0), Slow) as server:
        Slow.asked = 0
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def test_what_takes_work_is_waited_for_and_sent_once(slow: ThreadingHTTPServer):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    with connect(f"http://127.0.0.1:{slow.server_port}", timeout=0.2, retry=QUICK) as store:
        assert store.create("slow", [drive(0, 5)], **names).name == "slow"
        with pytest.raises(sd.ServiceError, match="timed out"):
            store.names()
    assert Slow.asked == 1


def test_the_wait_for_work_ends_with_an_error_that_says_what_may_have_happened(
    slow: ThreadingHTTPServer,
):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    url = f"http://127.0.0.1:{slow.server_port}"
    store = connect(url, work_timeout=0.2, retry=QUICK)
    with store, pytest.raises(sd.ServiceError, match="the change may have been made"):
        store.create("slow", [drive(0, 5)], **names)
    assert Slow.asked == 1


@pytest.mark.parametrize(
    ("status", "kind"),
    [
        (404, sd.NotFoundError),
        (409, sd.ConflictError),
        (422, sd.InvalidInputError),
        (413, sd.InvalidInputError),
        (401, sd.ServiceError),
        (403, sd.ServiceError),
        (500, sd.ServiceError),
    ],
)
def test_problems_are_the_errors_of_the_library(status: int, kind: type[Exception]):
    problem = {"title": "T", "status": status, "detail": "what went wrong", "errors": []}
    store, _ = scripted_store(httpx.Response(status, json=problem))
    with pytest.raises(kind, match="what went wrong"):
        store.names()


def test_a_response_that_is_no_problem_is_described_by_its_status():
    store, _ = scripted_store(httpx.Response(502, text="<html>"))
    with pytest.raises(sd.ServiceError, match="502"):
        store.names()


def test_waits_grow_with_jitter_up_to_a_longest():
    policy = RetryPolicy(first=1, longest=8, total=60)
    for attempt, most in enumerate([1, 2, 4, 8, 8, 8]):
        waits = [policy.seconds_before(attempt, 0) for _ in range(50)]
        assert most / 2 <= min(waits) < max(waits) <= most
    assert policy.seconds_before(0, 5.0) >= 5.0
    assert policy.seconds_before(10_000, 0) <= 8
