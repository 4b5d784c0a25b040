"""Operation: health, metrics, logs, limits, keys, slow clients, overload, an orderly end."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from ssil_service import embedded
from ssil_service.gate import Gate
from ssil_service.keys import Keys, refuse_open_doors
from ssil_service.launching import Server, free_port, launched
from ssil_service.problems import Problem
from ssil_service.settings import Settings, read_settings

from ssil_data.client import connect
from ssil_data.errors import InvalidInputError

Serve = Callable[..., Server]
READ_KEY, WRITE_KEY = "reads-and-asks-only", "writes-and-deletes-too"
LCOR = "v1/datasets/drives/runs/vae/lcor"
HEAD = f"POST /{LCOR} HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\n"
BODY = {"states": [[1.0, 2.0, 3.0]]}


def test_health_limits_and_metrics_are_told(http: httpx.Client):
    assert http.get("healthz").json() == {"status": "ok"}
    assert http.get("readyz").json() == {"status": "ok"}
    assert http.get("v1/limits").json()["query_rows"] == 65_536
    http.post(LCOR, json=BODY)
    http.post(LCOR, json=BODY)
    text = http.get("metrics").text
    route = 'route="/v1/datasets/{dataset}/runs/{run}/lcor"'
    assert f'ssil_request_seconds_count{{method="POST",{route},status="200"}} 2.0' in text
    assert 'ssil_rows_total{route="lcor"} 2.0' in text
    assert "ssil_cache_hits 1.0" in text
    assert 'ssil_jobs{state="queued"} 0.0' in text


@pytest.fixture(scope="module")
def served_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the server below has its store and its log."""
    return tmp_path_factory.mktemp("server")


@pytest.fixture(scope="module")
def server(scored: Path, served_folder: Path) -> Iterator[Server]:
    """A service that is quick to lose its patience."""
    store = shutil.copytree(scored, served_folder / "store")
    flags = ("--header-seconds", "1", "--body-seconds", "1", "--grace-seconds", "5")
    server = launched(store, *flags, log=served_folder / "log")
    yield server
    begin = time.monotonic()
    with raw(server, f"{HEAD}Content-Length: 99\r\n\r\n{{".encode()):
        assert server.stop() == 0
    assert time.monotonic() - begin < 8


def test_a_request_id_is_taken_or_given_and_stands_in_the_log(server: Server, served_folder: Path):
    answer = httpx.get(f"{server.url}/v1/datasets", headers={"X-Request-ID": "my-request.1"})
    assert answer.headers["x-request-id"] == "my-request.1"
    odd = httpx.get(f"{server.url}/v1/datasets", headers={"X-Request-ID": 'a"b c'})
    assert odd.headers["x-request-id"] not in ('a"b c', "my-request.1")
    lines = [json.loads(line) for line in (served_folder / "log").read_text().splitlines()]
    (line,) = [line for line in lines if line.get("request_id") == "my-request.1"]
    assert (line["status"], line["method"], line["path"]) == (200, "GET", "/v1/datasets")
    assert line["level"] == "info" and line["milliseconds"] > 0


def test_what_the_client_has_is_not_sent_again(http: httpx.Client):
    for path in (
        "v1/datasets",
        "v1/datasets/drives",
        "v1/datasets/drives/episodes",
        "v1/datasets/drives/pairs",
        "v1/datasets/drives/runs",
        "v1/datasets/drives/runs/vae",
        "v1/datasets/drives/runs/vae/leverage",
    ):
        tag = http.get(path).headers["etag"]
        again = http.get(path, headers={"If-None-Match": f'"other", {tag}'})
        assert (again.status_code, again.content) == (304, b"")
        assert http.get(path, headers={"If-None-Match": '"other"'}).status_code == 200


def test_leverage_is_asked_by_episode_and_steps_and_page(http: httpx.Client):
    path = "v1/datasets/drives/runs/vae/leverage"
    some = http.get(path, params={"episode": 3, "first_step": 5, "last_step": 8}).json()
    assert (some["episode"], some["step"]) == ([3] * 4, [5, 6, 7, 8])
    answer = http.get(path, params={"limit": 100, "columns": "leverage"})
    assert answer.headers["x-total-count"] == "420"
    following = answer.headers["link"].split(">")[0].removeprefix("<")
    assert "offset=100" in following
    page = http.get(following).json()
    assert (page["offset"], len(page["leverage"]), "step" in page) == (100, 100, False)


def test_the_cache_stays_within_its_bound(folder: Path):
    with embedded(folder, cache_bytes=10_000) as store:
        http = store.connection.client
        for alpha in range(1, 9):
            assert http.post(LCOR, params={"alpha": alpha}, json=BODY).status_code == 200
        text = http.get("metrics").text
        assert "ssil_cache_entries 1.0" in text
        assert "ssil_cache_misses 8.0" in text


@pytest.mark.parametrize("header", ["X-API-Key", "Authorization"])
def test_keys_open_what_they_may(header: str, folder: Path):
    prefix = "Bearer " if header == "Authorization" else ""
    with embedded(folder, read_key=READ_KEY, write_key=WRITE_KEY) as store:
        http = store.connection.client

        def status(method: str, path: str, key: str | None) -> int:
            headers = {} if key is None else {header: f"{prefix}{key}"}
            return http.request(method, path, headers=headers).status_code

        for path in ("v1/datasets", "v1/limits", "metrics", "v2"):
            assert [status("GET", path, key) for key in (None, "wrong", READ_KEY, WRITE_KEY)] == [
                401,
                401,
                200,
                200,
            ]
        gone = "v1/datasets/nope"
        assert [status("DELETE", gone, key) for key in (None, "wrong", READ_KEY, WRITE_KEY)] == [
            401,
            401,
            403,
            404,
        ]
        for path in ("healthz", "readyz", "v2/health/live", "v2/health/ready"):
            assert status("GET", path, None) == 200


def test_a_key_may_be_given_as_its_digest():
    import hashlib

    digest = hashlib.sha256(READ_KEY.encode()).hexdigest()
    keys = Keys.of(Settings(read_key=f"sha256:{digest}, another-long-key-too"))  # pyright: ignore
    assert keys.may(READ_KEY, write=False) == (True, True)
    assert keys.may("another-long-key-too", write=True) == (True, False)
    assert keys.may(digest, write=False) == (False, False)


@pytest.mark.parametrize("key", ["short", "sha256:abc", "sha256:" + "0" * 63])
def test_a_short_or_odd_key_is_refused_without_being_told(key: str):
    with pytest.raises(InvalidInputError) as refusal:
        Keys.of(Settings(write_key=key))  # pyright: ignore
    assert key not in str(refusal.value)


def test_other_machines_need_a_key():
    for host in ("0.0.0.0", "192.168.0.1", "::", "example.org"):
        with pytest.raises(InvalidInputError, match="loopback"):
            refuse_open_doors(Settings(host=host))
        refuse_open_doors(Settings(host=host, read_key=READ_KEY))  # pyright: ignore
    for host in ("127.0.0.1", "::1", "localhost", "127.9.9.9"):
        refuse_open_doors(Settings(host=host))


def test_settings_come_from_flags_then_the_environment(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SSIL_PORT", "81")
    monkeypatch.setenv("SSIL_HOST", "localhost")
    settings = read_settings(port=82)
    assert (settings.port, settings.host) == (82, "localhost")
    with pytest.raises(InvalidInputError, match="port"):
        read_settings(port=-1)
    monkeypatch.setenv("SSIL_WRITE_KEY", WRITE_KEY)
    assert WRITE_KEY not in repr(read_settings())


@pytest.mark.parametrize("flags", [["--host", "0.0.0.0"], ["--port", "-1"]])
def test_the_command_refuses_with_status_2(flags: list[str], tmp_path: Path):
    command = [sys.executable, "-c", "from ssil_data.cli import main; main()", "serve", *flags]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert flags[0].removeprefix("--").split("-")[0] in done.stderr


def raw(server: Server, data: bytes) -> socket.socket:
    host, port = server.url.removeprefix("http://").split(":")
    connection = socket.create_connection((host, int(port)), timeout=20)
    connection.sendall(data)
    return connection


def test_slow_clients_are_dropped_and_others_are_served(server: Server):
    half = HEAD.encode()
    silent = [raw(server, b"") for _ in range(10)]
    heads = [raw(server, half) for _ in range(10)]
    bodies = [raw(server, half + b"Content-Length: 99\r\n\r\n{") for _ in range(10)]
    assert httpx.post(f"{server.url}/{LCOR}", json=BODY).status_code == 200
    for connection in (*silent, *heads):
        assert connection.recv(100) == b""
    for connection in bodies:
        assert connection.recv(1000).startswith(b"HTTP/1.1 408")
    assert httpx.post(f"{server.url}/{LCOR}", json=BODY).status_code == 200
    for connection in (*silent, *heads, *bodies):
        connection.close()


def test_clients_that_hang_up_do_no_harm(server: Server, served_folder: Path):
    body = json.dumps(BODY).encode()
    whole = f"{HEAD}Content-Length: {len(body)}\r\n\r\n".encode() + body
    upload = b"PUT /v1/datasets/cut HTTP/1.1\r\nHost: a\r\nContent-Length: 9999\r\n"
    upload += b"Content-Type: application/vnd.apache.arrow.stream\r\n\r\nhalf"
    for cut in (10, len(whole) - 5, len(whole)):
        raw(server, whole[:cut]).close()
        raw(server, upload).close()
    assert httpx.post(f"{server.url}/{LCOR}", json=BODY).status_code == 200
    assert httpx.get(f"{server.url}/v1/datasets/cut").status_code == 404
    time.sleep(0.2)
    (place,) = (served_folder / "store" / ".service" / "servers").iterdir()
    assert [path.name for path in place.iterdir()] == ["lock"]


def test_bytes_that_are_no_http_are_a_problem(server: Server):
    with raw(server, b"\x16\x03\x01 hello\r\n\r\n") as connection:
        answer = connection.recv(1000)
    assert answer.startswith(b"HTTP/1.1 400") and b"application/problem+json" in answer


def test_a_full_gate_refuses_at_once_with_a_time_to_wait():
    import asyncio

    async def overload() -> list[BaseException | None]:
        gate = Gate(computing=1, waiting=2)
        tasks = [asyncio.ensure_future(gate.run(lambda: time.sleep(0.05))) for _ in range(6)]
        done = await asyncio.gather(*tasks, return_exceptions=True)
        gate.close()
        return done

    done = asyncio.run(overload())
    refused = [each for each in done if isinstance(each, Problem)]
    assert len(refused) == 3
    assert {each.status for each in refused} == {503}
    assert int(refused[0].headers["Retry-After"]) >= 1


def test_too_many_requests_at_once_are_refused_but_health_is_told(folder: Path):
    with embedded(folder, requests=1) as store:
        http = store.connection.client
        job = http.post("v1/datasets/drives/runs", json={"estimator": {"kind": "gpr"}}).json()[
            "job"
        ]
        with http.stream("GET", f"v1/jobs/{job}/events") as events:
            next(events.iter_lines())
            assert http.get("v1/datasets").status_code == 503
            assert http.get("v1/datasets").headers["retry-after"] == "1"
            assert http.get("healthz").status_code == 200


def test_a_new_run_is_seen_without_restart(http: httpx.Client, local):
    import ssil_data as sd

    assert http.get("v1/datasets/drives/runs/late").status_code == 404
    sd.score(local["drives"], sd.VAE(steps=5), run="late")
    assert http.get("v1/datasets/drives/runs/late").status_code == 200
    before = http.get("v1/datasets/drives").json()["version"]
    local["drives"].append([sd.Episode([[1.0, 2, 3]], [[0.0, 1]])])
    assert http.get("v1/datasets/drives").json()["version"] != before
    assert http.post(LCOR, json=BODY).status_code == 409
    assert http.post(LCOR, params={"version": before}, json=BODY).status_code == 200


@pytest.mark.skipif(not hasattr(os, "kill"), reason="no signals here")
def test_event_streams_end_when_the_service_is_asked_to(folder: Path, serve: Serve):
    server = serve(folder, "--jobs", "1")
    with httpx.Client(base_url=server.url) as http:
        job = http.post(
            "v1/datasets/drives/runs", json={"estimator": {"kind": "vae", "steps": 300}}
        ).json()["job"]
        with http.stream("GET", f"v1/jobs/{job}/events") as events:
            lines = events.iter_lines()
            next(lines)
            os.kill(server.process.pid, signal.SIGTERM)
            assert not any("data" in line and "succeeded" in line for line in lines)
    assert server.process.wait(60) == 0


def test_a_service_that_is_killed_and_restarted_delays_a_client_and_changes_nothing(
    folder: Path, states: np.ndarray
):
    port = free_port()
    server = launched(folder, port=port)
    with connect(server.url) as store:
        field = store["drives"].field("vae")
        expected = field.lcor(states).values
        found: list[np.ndarray] = []
        asking = threading.Event()

        def ask() -> None:
            while len(found) < 500:
                found.append(field.lcor(states).values)
                asking.set()

        client = threading.Thread(target=ask)
        client.start()
        asking.wait(60)
        server.kill()
        server = launched(folder, port=port)
        client.join()
        server.kill()
    assert len(found) == 500
    assert all(np.array_equal(values, expected) for values in found)
