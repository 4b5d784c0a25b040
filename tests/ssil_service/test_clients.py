"""Clients that are slow, hang up, do not read, or speak no HTTP."""

import json
import socket
import time
from collections.abc import Callable
from pathlib import Path

import httpx

from ssil_service.server.launch import Server

Raw = Callable[..., socket.socket]
LCOR = "v1/datasets/drives/runs/vae/lcor"
HEAD = f"POST /{LCOR} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
BODY = {"states": [[1.0, 2.0, 3.0]]}


def test_slow_clients_are_dropped_and_others_are_served(server: Server, raw: Raw):
    half = HEAD.encode()
    silent = [raw() for _ in range(10)]
    heads = [raw(half) for _ in range(10)]
    bodies = [raw(half + b"Content-Length: 99\r\n\r\n{") for _ in range(10)]
    assert httpx.post(f"{server.url}/{LCOR}", json=BODY).status_code == 200
    for connection in (*silent, *heads):
        assert connection.recv(100) == b""
    for connection in bodies:
        assert connection.recv(1000).startswith(b"HTTP/1.1 408")
    assert httpx.post(f"{server.url}/{LCOR}", json=BODY).status_code == 200
    for connection in (*silent, *heads, *bodies):
        connection.close()


def test_clients_that_hang_up_do_no_harm(server: Server, served_folder: Path, raw: Raw):
    body = json.dumps(BODY).encode()
    whole = f"{HEAD}Content-Length: {len(body)}\r\n\r\n".encode() + body
    upload = b"PUT /v1/datasets/cut HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9999\r\n"
    upload += b"Content-Type: application/vnd.apache.arrow.stream\r\n\r\nhalf"
    for cut in (10, len(whole) - 5, len(whole)):
        raw(whole[:cut]).close()
        raw(upload).close()
    assert httpx.post(f"{server.url}/{LCOR}", json=BODY).status_code == 200
    assert httpx.get(f"{server.url}/v1/datasets/cut").status_code == 404
    time.sleep(0.2)
    (place,) = (served_folder / "store" / ".service" / "servers").iterdir()
    assert [path.name for path in place.iterdir()] == ["lock"]


def test_bytes_other_than_http_are_answered_with_a_problem(raw: Raw):
    with raw(b"\x16\x03\x01 hello\r\n\r\n") as connection:
        answer = connection.recv(1000)
    assert answer.startswith(b"HTTP/1.1 400") and b"application/problem+json" in answer


def test_a_head_sent_byte_by_byte_is_dropped_in_time(raw: Raw):
    connection = raw()
    begin = time.monotonic()
    connection.settimeout(0.05)
    for letter in HEAD * 10:
        if time.monotonic() - begin > 5:
            break
        try:
            connection.sendall(letter.encode())
            if connection.recv(10) == b"":
                break
        except TimeoutError:
            continue
        except OSError:
            break
    assert time.monotonic() - begin < 5


PAIRS = b"GET /v1/datasets/many/pairs HTTP/1.1\r\nHost: localhost\r\n"
PAIRS += b"Accept: application/vnd.apache.arrow.stream\r\n\r\n"


def test_a_client_that_never_reads_is_disconnected_and_its_memory_freed(server: Server, raw: Raw):
    def metric(name: str) -> float:
        lines = httpx.get(f"{server.url}/metrics").text.splitlines()
        (line,) = [line for line in lines if line.startswith(f"{name} ")]
        return float(line.split()[1])

    unread = [raw(PAIRS, buffer=4096) for _ in range(3)]
    deadline = time.monotonic() + 10
    while metric("ssil_held_bytes") < 10_000_000 and time.monotonic() < deadline:
        time.sleep(0.05)
    assert metric("ssil_held_bytes") > 10_000_000
    while metric("ssil_held_bytes") > 10_000 and time.monotonic() < deadline:
        time.sleep(0.1)
    assert metric("ssil_requests_in_flight") == 1
    for connection in unread:
        received = 0
        try:
            while part := connection.recv(2**20):
                received += len(part)
        except ConnectionResetError:
            pass
        assert received < 14_400_000


def test_a_client_that_reads_slowly_but_steadily_gets_everything(raw: Raw):
    connection = raw(PAIRS, buffer=4096)
    begin = time.monotonic()
    head, _, rest = connection.recv(2000).partition(b"\r\n\r\n")
    expected = int(head.lower().split(b"content-length: ")[1].split(b"\r\n")[0])
    received = len(rest)
    while received < expected:
        part = connection.recv(2**20)
        assert part
        received += len(part)
        time.sleep(2.5 * len(part) / expected)
    assert time.monotonic() - begin > 2  # twice the service's time-out


def test_connections_beyond_the_limit_are_closed_at_once(server: Server, raw: Raw):
    open_connections = [raw() for _ in range(60)]
    late = raw()
    late.settimeout(0.5)  # sooner than a silent one is dropped
    assert late.recv(10) == b""
    for connection in open_connections:
        connection.close()
    assert httpx.get(f"{server.url}/healthz").status_code == 200
