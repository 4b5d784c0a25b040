"""Two servers on one store: each makes its own runs, and adopts the jobs of dead servers only."""

import fcntl
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx

import ssil_data as sd
from ssil_service import embed
from ssil_service.server.launch import Server

RUNS = "v1/datasets/drives/runs"
LONG = {"estimator": {"kind": "vae", "steps": 1_000_000}}


def quick(seed: int) -> dict[str, Any]:
    return {"estimator": {"kind": "vae", "steps": 10}, "seed": seed}


def until(http: httpx.Client, job: str, *states: str) -> dict[str, Any]:
    deadline = time.monotonic() + 60
    while (found := http.get(f"v1/jobs/{job}").json())["state"] not in states:
        assert time.monotonic() < deadline, found
        time.sleep(0.05)
    return found


@contextmanager
def last_worker(folder: Path) -> Iterator[None]:
    """Hold the only server's lock, as a worker does that has not ended yet."""
    (lock,) = folder.glob(".service/servers/*/lock")
    with lock.open() as handle:
        fcntl.flock(handle, fcntl.LOCK_SH)
        yield


def listed(http: httpx.Client) -> list[dict[str, Any]]:
    """Jobs without their progress, which only a job's own server knows."""
    return [{**job, "progress": None} for job in http.get("v1/jobs").json()["jobs"]]


def test_jobs_submitted_to_two_servers_at_once_make_a_run_each(folder: Path):
    with embed(folder, jobs=1) as first, embed(folder, jobs=1) as second:
        clients = [first.connection.client, second.connection.client]

        def submit(seed: int) -> dict[str, Any]:
            return clients[seed % 2].post(RUNS, json=quick(seed)).json()

        # FastAPI builds a route at its first request, which two threads of a process must not do
        jobs = [submit(0), submit(1)]
        with ThreadPoolExecutor(6) as pool:
            jobs += pool.map(submit, range(2, 8))
        names = {job["run"] for job in jobs}
        assert names == {f"vae-{number}" for number in range(2, 10)}
        # each server shows the other's jobs as they are
        for seed, job in enumerate(jobs):
            done = until(clients[(seed + 1) % 2], job["job"], "succeeded", "failed")
            assert (done["state"], done["run"]) == ("succeeded", job["run"])
        runs = sd.Store(folder)["drives"].runs
        assert [runs[job["run"]].seed for job in jobs] == list(range(8))
        assert listed(clients[0]) == listed(clients[1])


def test_a_server_that_starts_adopts_the_jobs_of_dead_servers_and_not_of_living_ones(
    folder: Path, serve: Callable[..., Server]
):
    dead = serve(folder, "--jobs", "1")
    with embed(folder, jobs=1) as living, httpx.Client(base_url=dead.url) as dying:
        here = living.connection.client
        own = here.post(RUNS, json={**LONG, "run": "own"}).json()["job"]
        cut = dying.post(RUNS, json={**LONG, "run": "cut"}).json()["job"]
        waiting = dying.post(RUNS, json={**quick(1), "run": "waiting"}).json()["job"]
        until(here, own, "running")
        until(here, cut, "running")
        dead.kill()
        with embed(folder, jobs=1) as third:
            there = third.connection.client
            assert until(there, cut, "failed")["error"]["kind"] == "ServerStoppedError"
            assert until(there, waiting, "succeeded")["run"] == "waiting"
            assert there.get(f"v1/jobs/{own}").json()["state"] == "running"
            assert there.post(f"v1/jobs/{own}/cancel").status_code == 409
            assert there.delete("v1/datasets/drives").status_code == 409
            assert there.post(RUNS, json={**quick(2), "run": "own"}).status_code == 409
            here.post(f"v1/jobs/{own}/cancel")
            assert until(there, own, "cancelled")["error"] is None
            assert there.post(f"v1/jobs/{own}/cancel").json()["state"] == "cancelled"
    assert sd.Store(folder)["drives"].runs.names() == ["vae", "waiting"]


def test_a_server_that_starts_before_the_dead_one_s_last_worker_ends_adopts_its_jobs_later(
    folder: Path, serve: Callable[..., Server]
):
    dead = serve(folder, "--jobs", "1")
    with httpx.Client(base_url=dead.url) as dying:
        cut = dying.post(RUNS, json={**LONG, "run": "cut"}).json()["job"]
        waiting = [
            dying.post(RUNS, json={**quick(seed), "run": f"waiting-{seed}"}).json()["job"]
            for seed in (1, 2)
        ]
        until(dying, cut, "running")
    with ExitStack() as worker:
        worker.enter_context(last_worker(folder))
        dead.kill()
        with embed(folder, jobs=1) as early:
            there = early.connection.client
            assert there.get(f"v1/jobs/{cut}").json()["state"] == "running"
            worker.close()
            assert until(there, cut, "failed")["error"]["kind"] == "ServerStoppedError"
            # it has one thread, and takes the second when the first is done
            names = [until(there, job, "succeeded")["run"] for job in waiting]
    assert names == ["waiting-1", "waiting-2"]
