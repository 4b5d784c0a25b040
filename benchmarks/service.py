"""What does the service cost beside the call that it makes?

On loopback, interleaved with the in-process call in one run, medians: LCoR of 2,048 states over
Arrow and JSON, over a socket and embedded; the leverage of a whole run; 64 concurrent clients with
small questions beside a bare FastAPI echo of the same payload; the time to `/readyz`.
"""

from __future__ import annotations

import asyncio
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import httpx
import numpy as np
from ssil_service import embedded
from ssil_service.launching import Server, free_port, launched

import ssil_data as sd
from ssil_data.client import RemoteStore, connect
from ssil_data.client.wire import ARROW, encoded, states_table

ROUNDS = 15
CLIENTS, REQUESTS = 64, 40
LCOR = "/v1/datasets/racetrack/runs/windowvae/lcor"
COR = "/v1/datasets/racetrack/runs/windowvae/cor"

ECHO = """
import sys
import uvicorn
from fastapi import FastAPI, Request, Response

app = FastAPI()

@app.post("/echo")
async def echo(request: Request) -> Response:
    return Response(await request.body(), media_type="application/octet-stream")

uvicorn.run(app, port=int(sys.argv[1]), log_level="error", access_log=False, http="h11", loop="asyncio")
"""


def interleaved(calls: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Return the median seconds of each call, all in turn, after one round that does not count."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for number in range(ROUNDS + 1):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            if number:
                times[name].append(time.perf_counter() - begin)
    return {name: statistics.median(seconds) for name, seconds in times.items()}


def table(title: str, medians: dict[str, float]) -> None:
    """Print times beside the first of them."""
    base = next(iter(medians.values()))
    print(f"\n{title}: milliseconds, and beside the first")
    for name, seconds in medians.items():
        print(f"  {name:<34}{1000 * seconds:>9.2f}{seconds / base:>8.2f}")


def bulk(store: Path, remote: RemoteStore, inside: RemoteStore) -> None:
    """Time LCoR of 2,048 states, and the leverage of a whole run."""
    dataset = sd.Store(store)["racetrack"]
    field = dataset.field("windowvae")
    states = dataset.pairs().states[::24][:2048]
    over_socket = remote["racetrack"].field("windowvae")
    over_memory = inside["racetrack"].field("windowvae")
    http = remote.connection.client
    body = {"states": states.tolist()}
    assert np.array_equal(over_socket.lcor(states).values, field.lcor(states).values)
    assert np.array_equal(over_memory.lcor(states).values, field.lcor(states).values)
    table(
        f"LCoR of {len(states):,} states, {len(field.states):,} demonstrations, alpha {field.alpha:.0f}",
        interleaved(
            {
                "in process": lambda: field.lcor(states),
                "client, Arrow, socket": lambda: over_socket.lcor(states),
                "client, Arrow, embedded": lambda: over_memory.lcor(states),
                "JSON, socket": lambda: http.post(LCOR, json=body).json(),
            }
        ),
    )
    table(
        "LCoR of one state",
        interleaved(
            {
                "in process": lambda: field.lcor(states[:1]),
                "client, Arrow, socket": lambda: over_socket.lcor(states[:1]),
                "client, Arrow, embedded": lambda: over_memory.lcor(states[:1]),
            }
        ),
    )
    there = remote["racetrack"]
    table(
        f"Leverage of {len(dataset):,} pairs",
        interleaved(
            {
                "local store": lambda: dataset.leverage("windowvae"),
                "client, Arrow, socket": lambda: there.leverage("windowvae"),
            }
        ),
    )


async def crowd(url: str, path: str, body: bytes) -> tuple[list[float], float, int, int]:
    """Let 64 clients ask at once: latencies of answers, answers a second, refusals, errors."""
    latencies: list[float] = []
    refused = failed = 0

    async def client(http: httpx.AsyncClient) -> None:
        nonlocal refused, failed
        for _ in range(REQUESTS):
            begin = time.perf_counter()
            try:
                answer = await http.post(path, content=body, headers={"Content-Type": ARROW})
            except httpx.HTTPError:
                failed += 1
                continue
            if answer.status_code == 200:
                latencies.append(time.perf_counter() - begin)
            elif answer.status_code in (429, 503):
                refused += 1
            else:
                failed += 1

    limits = httpx.Limits(max_connections=CLIENTS, max_keepalive_connections=CLIENTS)
    async with httpx.AsyncClient(base_url=url, limits=limits, timeout=60) as http:
        await http.post(path, content=body, headers={"Content-Type": ARROW})
        begin = time.perf_counter()
        await asyncio.gather(*(client(http) for _ in range(CLIENTS)))
        seconds = time.perf_counter() - begin
    return latencies, len(latencies) / seconds, refused, failed


def concurrent(store: Path, server: Server) -> None:
    """Ask small questions from 64 clients, and a bare echo the same."""
    port = free_port()
    echo = subprocess.Popen([sys.executable, "-c", ECHO, str(port)])
    states = sd.Store(store)["racetrack"].pairs().states
    asked = {
        "bare FastAPI echo": (f"http://127.0.0.1:{port}", "/echo", 8),
        "CoR of 8 states": (server.url, COR, 8),
        "LCoR of 1 state": (server.url, LCOR, 1),
        "LCoR of 8 states": (server.url, LCOR, 8),
    }
    time.sleep(2)
    found: dict[str, list[tuple[list[float], float, int, int]]] = {name: [] for name in asked}
    for _ in range(3):
        for name, (url, path, rows) in asked.items():
            body = encoded(states_table(states[:rows])).to_pybytes()
            found[name].append(asyncio.run(crowd(url, path, body)))
    echo.kill()
    print(f"\n{CLIENTS} clients at once, {CLIENTS * REQUESTS:,} questions each of 3 rounds")
    head = ("", "median ms", "p99 ms", "p99/median", "answers/s", "of echo", "refused", "errors")
    print(f"  {head[0]:<20}" + "".join(f"{each:>12}" for each in head[1:]))
    base = statistics.median(rate for _, rate, _, _ in found["bare FastAPI echo"])
    for name, rounds in found.items():
        latencies = sorted(each for one in rounds for each in one[0])
        median, worst = statistics.median(latencies), latencies[int(0.99 * len(latencies))]
        rate = statistics.median(rate for _, rate, _, _ in rounds)
        refused, failed = sum(one[2] for one in rounds), sum(one[3] for one in rounds)
        numbers = (1000 * median, 1000 * worst, worst / median, rate, rate / base)
        cells = "".join(f"{each:>12.2f}" for each in numbers)
        print(f"  {name:<20}{cells}{refused:>12}{failed:>12}")


def start(store: Path) -> None:
    """Time from the command to the first answer of `/readyz`."""
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        server = launched(store)
        times.append(time.perf_counter() - begin)
        server.stop()
    print(f"\nFrom the command to /readyz: {statistics.median(times):.2f} s (median of 5)")


def main() -> None:
    """Print all tables."""
    with tempfile.TemporaryDirectory() as folder:
        store = Path(shutil.copytree(Path(__file__).parents[1] / "datasets", f"{folder}/datasets"))
        sd.score(sd.Store(store)["racetrack"], sd.WindowVAE())
        server = launched(store)
        with connect(server.url) as remote, embedded(store) as inside:
            bulk(store, remote, inside)
        concurrent(store, server)
        server.stop()
        start(store)


if __name__ == "__main__":
    main()
