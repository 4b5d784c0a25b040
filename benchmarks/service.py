"""What does the service cost beside the call that it makes?

On loopback, interleaved with the in-process call in one run, medians: LCoR of 2,048 states over
Arrow and JSON, over a socket and embedded; the leverage of a whole run; 64 concurrent clients with
small questions beside a bare FastAPI echo of the same payload, which logs its requests as uvicorn
does by itself; the time to `/readyz`.
"""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ssil_data as sd
from ssil_data.client import RemoteStore, connect
from ssil_data.client.wire import ARROW, JSON, encode, states_table
from ssil_service import embed
from ssil_service.server.launch import Server, free_port, launch

ROUNDS = 15
CLIENTS = 64
REQUESTS = 25
"""Requests of each client in a round."""
CROWDS = 5
"""Rounds of all clients at once."""
LCOR = "/v1/datasets/racetrack/runs/windowvae/lcor"
COR = "/v1/datasets/racetrack/runs/windowvae/cor"

ECHO = """
import sys
import uvicorn
from fastapi import FastAPI, Request, Response
from pydantic import BaseModel

app = FastAPI()

class States(BaseModel):
    states: list[list[float]]

@app.post("/typed")
async def typed(states: States) -> States:
    return states

@app.post("/echo")
async def echo(request: Request) -> Response:
    return Response(await request.body(), media_type="application/octet-stream")

uvicorn.run(app, port=int(sys.argv[1]), http="h11", loop="asyncio")
"""


def time_in_turns(calls: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Return the median seconds of each call; they run in turns, the first round is not counted."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for number in range(ROUNDS + 1):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            if number:
                times[name].append(time.perf_counter() - begin)
    return {name: statistics.median(seconds) for name, seconds in times.items()}


def print_table(title: str, medians: dict[str, float]) -> None:
    """Print times, and their ratios to the first."""
    base = next(iter(medians.values()))
    print(f"\n{title}: milliseconds, and beside the first")
    for name, seconds in medians.items():
        print(f"  {name:<34}{1000 * seconds:>9.2f}{seconds / base:>8.2f}")


def print_bulk(store: Path, remote: RemoteStore, inside: RemoteStore) -> None:
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
    print_table(
        f"LCoR of {len(states):,} states, {len(field.states):,} demonstrations",
        time_in_turns(
            {
                "in process": lambda: field.lcor(states),
                "client, Arrow, socket": lambda: over_socket.lcor(states),
                "client, Arrow, embedded": lambda: over_memory.lcor(states),
                "JSON, socket": lambda: http.post(LCOR, json=body).json(),
            }
        ),
    )
    print_table(
        "LCoR of one state",
        time_in_turns(
            {
                "in process": lambda: field.lcor(states[:1]),
                "client, Arrow, socket": lambda: over_socket.lcor(states[:1]),
                "client, Arrow, embedded": lambda: over_memory.lcor(states[:1]),
            }
        ),
    )
    there = remote["racetrack"]
    print_table(
        f"Leverage of {len(dataset):,} pairs",
        time_in_turns(
            {
                "local store": lambda: dataset.leverage("windowvae"),
                "client, Arrow, socket": lambda: there.leverage("windowvae"),
            }
        ),
    )


@dataclass
class Crowd:
    """What 64 clients saw that asked at once, and what that cost the server."""

    latencies: list[float]
    seconds: float
    processor: float
    refused: int = 0
    failed: int = 0


async def ask_in_parallel(port: int, process: int, path: str, media: str, body: bytes) -> Crowd:
    """Ask from 64 connections; the clients speak HTTP by hand, to cost little themselves."""
    head = (
        f"POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: {media}\r\nAccept: {media}\r\n"
        f"Content-Length: {len(body)}\r\n\r\n"
    ).encode()
    found = Crowd([], 0.0, 0.0)

    async def client() -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        for _ in range(REQUESTS):
            begin = time.perf_counter()
            writer.write(head + body)
            answer = await reader.readuntil(b"\r\n\r\n")
            length = int(answer.lower().split(b"content-length: ")[1].split(b"\r\n")[0])
            await reader.readexactly(length)
            status = answer.split(b" ", 2)[1]
            if status == b"200":
                found.latencies.append(time.perf_counter() - begin)
            elif status in (b"429", b"503"):
                found.refused += 1
            else:
                found.failed += 1
        writer.close()

    begin = time.perf_counter()
    used = processor_seconds(process)
    await asyncio.gather(*(client() for _ in range(CLIENTS)))
    found.seconds = time.perf_counter() - begin
    found.processor = processor_seconds(process) - used
    return found


def processor_seconds(process: int) -> float:
    """Return the processor time that a process has taken, from /proc."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def print_crowds(store: Path, server: Server) -> None:
    """Ask small questions from 64 clients, and a bare echo the same."""
    port = free_port()
    quiet = subprocess.DEVNULL
    command = [sys.executable, "-c", ECHO, str(port)]
    echo = subprocess.Popen(command, stdout=quiet, stderr=quiet)
    states = sd.Store(store)["racetrack"].pairs().states
    served = int(server.url.rpartition(":")[2])
    some = states[:8]
    arrow = (ARROW, encode(states_table(some)).to_pybytes())
    one = (ARROW, encode(states_table(some[:1])).to_pybytes())
    text = (JSON, json.dumps({"states": some.tolist()}).encode())
    mine = (served, server.process.pid)
    theirs = (port, echo.pid)
    questions = {
        "echo of bytes": (*theirs, "/echo", *arrow),
        "CoR of 8, Arrow": (*mine, COR, *arrow),
        "LCoR of 1, Arrow": (*mine, LCOR, *one),
        "LCoR of 8, Arrow": (*mine, LCOR, *arrow),
        "echo of typed JSON": (*theirs, "/typed", *text),
        "CoR of 8, JSON": (*mine, COR, *text),
    }
    time.sleep(2)
    found: dict[str, list[Crowd]] = {name: [] for name in questions}
    for _ in range(CROWDS + 1):
        for name, question in questions.items():
            found[name].append(asyncio.run(ask_in_parallel(*question)))
    echo.kill()
    print(f"\n{CLIENTS} clients at once, {CROWDS} rounds of {CLIENTS * REQUESTS:,} questions each")
    head = ("median ms", "p99 ms", "p99/median", "answers/s", "of echo", "cpu ms", "of echo")
    print(f"  {'':<20}" + "".join(f"{each:>12}" for each in (*head, "refused", "errors")))
    base: list[float] = []
    for name, (_, *rounds) in found.items():
        latencies = sorted(each for one in rounds for each in one.latencies)
        median = statistics.median(latencies)
        worst = latencies[int(0.99 * len(latencies))]
        rate = statistics.median(len(one.latencies) / one.seconds for one in rounds)
        cost = statistics.median(one.processor / len(one.latencies) for one in rounds)
        base = [rate, cost] if name.startswith("echo") else base
        numbers = (1000 * median, 1000 * worst, worst / median, rate, rate / base[0])
        numbers += (1000 * cost, cost / base[1])
        counts = (sum(one.refused for one in rounds), sum(one.failed for one in rounds))
        cells = "".join(f"{each:>12.2f}" for each in numbers)
        print(f"  {name:<20}{cells}{counts[0]:>12}{counts[1]:>12}")


def print_start(store: Path) -> None:
    """Time from the command to the first answer of `/readyz`."""
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        server = launch(store)
        times.append(time.perf_counter() - begin)
        server.stop()
    print(f"\nFrom the command to /readyz: {statistics.median(times):.2f} s (median of 5)")


def main() -> None:
    """Print all tables."""
    with tempfile.TemporaryDirectory() as folder:
        store = Path(shutil.copytree(Path(__file__).parents[1] / "datasets", f"{folder}/datasets"))
        sd.score(sd.Store(store)["racetrack"], sd.WindowVAE())
        server = launch(store)
        with connect(server.url) as remote, embed(store) as inside:
            print_bulk(store, remote, inside)
        print_crowds(store, server)
        server.stop()
        print_start(store)


if __name__ == "__main__":
    main()
