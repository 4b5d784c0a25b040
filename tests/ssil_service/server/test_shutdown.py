"""Shutdown: orderly after SIGTERM, harmless after a kill."""

import os
import signal
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

import httpx
import numpy as np

from ssil_data.client import connect
from ssil_service import create_app
from ssil_service.server.embedded import EmbeddedTransport
from ssil_service.server.launch import Server, free_port, launch
from ssil_service.settings import Settings

Serve = Callable[..., Server]


def test_event_streams_end_when_the_service_gets_sigterm(folder: Path, serve: Serve):
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


def test_a_client_outlives_a_service_that_is_killed_and_restarted_and_gets_the_same_values(
    folder: Path, states: np.ndarray
):
    port = free_port()
    server = launch(folder, port=port)
    with connect(server.url) as store:
        field = store["drives"].field("vae")
        expected = field.lcor(states).values
        found: list[np.ndarray] = []
        first_answer = threading.Event()

        def ask() -> None:
            while len(found) < 500:
                found.append(field.lcor(states).values)
                first_answer.set()

        client = threading.Thread(target=ask)
        client.start()
        first_answer.wait(60)
        server.kill()
        server = launch(folder, port=port)
        client.join()
        server.kill()
    assert len(found) == 500
    assert all(np.array_equal(values, expected) for values in found)


def test_requests_and_jobs_share_one_grace_period(folder: Path, serve: Serve, tmp_path: Path):
    server = serve(folder, "--jobs", "1", "--grace-seconds", "3", "--body-seconds", "60")
    with httpx.Client(base_url=server.url) as http:
        body = {"estimator": {"kind": "vae", "steps": 1_000_000}}
        job = http.post("v1/datasets/drives/runs", json=body).json()["job"]
        while http.get(f"v1/jobs/{job}").json()["state"] != "running":
            time.sleep(0.05)
    half = b"POST /v1/datasets/drives/runs HTTP/1.1\r\nHost: localhost\r\n"
    half += b"Content-Type: application/json\r\nContent-Length: 99\r\n\r\n{"
    host, port = server.url.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port)), timeout=20) as stuck:
        stuck.sendall(half)
        time.sleep(0.2)
        started_at = time.monotonic()
        assert server.stop() == 0
        assert time.monotonic() - started_at < 5  # of three seconds, not twice three
        assert stuck.recv(1000).startswith(b"HTTP/1.1 503")
    log = (tmp_path / "log-0").read_text()
    assert "Traceback" not in log and "Exception" not in log


def test_readyz_says_during_shutdown_when_to_retry(folder: Path):
    app = create_app(Settings(store=str(folder)), hosts=["here"])
    with httpx.Client(transport=EmbeddedTransport(app), base_url="http://here") as http:
        assert http.get("readyz").status_code == 200
        app.begin_shutdown()
        answer = http.get("readyz")
        assert (answer.status_code, answer.headers["retry-after"]) == (503, "1")
