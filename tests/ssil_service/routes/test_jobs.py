"""Jobs: accepted durably, cancelled, found again after a crash, run by whichever server lives."""

import json
import shutil
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import httpx
import pytest

import ssil_data as sd
from ssil_data.client import RemoteStore, connect
from ssil_service import embed
from ssil_service.server.launch import Server
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives

NAMES = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
Serve = Callable[..., Server]
RUNS = "v1/datasets/drives/runs"
"""Of the dataset in the store that a test has for itself."""
QUICK = {"estimator": {"kind": "vae", "steps": 10}}
LONG = {"estimator": {"kind": "vae", "steps": 1_000_000}}
NUMBERS = count()


@pytest.fixture(scope="module")
def shared_store(scored: Path, tmp_path_factory: pytest.TempPathFactory) -> sd.Store:
    """A store for the tests that need no service of their own, each with a dataset of its own."""
    return sd.Store(shutil.copytree(scored, tmp_path_factory.mktemp("jobs") / "store"))


@pytest.fixture(scope="module")
def http(shared_store: sd.Store) -> Iterator[httpx.Client]:
    """Plain requests to one service of that store, whose worker imports torch only once."""
    with embed(shared_store.folder.uri, jobs=1) as store:
        yield store.connection.client


@pytest.fixture
def own(shared_store: sd.Store) -> sd.Dataset:
    """A dataset for one test alone, with a run `vae`."""
    made = shared_store.create(f"drives-{next(NUMBERS)}", drives(), **NAMES)
    sd.score(made, sd.VAE(steps=10), run="vae")
    return made


@pytest.fixture
def path(own: sd.Dataset) -> str:
    """Where the service has that dataset."""
    return f"v1/datasets/{own.name}"


def ended(http: httpx.Client, job: str) -> dict[str, Any]:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        found = http.get(f"v1/jobs/{job}").json()
        if found["state"] in ("succeeded", "failed", "cancelled"):
            return found
        time.sleep(0.05)
    raise TimeoutError(job)


def running(http: httpx.Client, job: str) -> None:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and http.get(f"v1/jobs/{job}").json()["progress"] is None:
        time.sleep(0.05)


def test_a_job_is_accepted_and_ends_with_its_run(http: httpx.Client, own: sd.Dataset, path: str):
    answer = http.post(f"{path}/runs", json={**QUICK, "run": "mine", "seed": 3})
    assert answer.status_code == 202
    job = answer.json()
    assert answer.headers["location"] == f"/v1/jobs/{job['job']}"
    done = ended(http, job["job"])
    assert (done["state"], done["run"], done["error"]) == ("succeeded", "mine", None)
    assert done["progress"] == {"what": "score", "done": 420, "of": 420}
    assert own.runs["mine"].seed == 3
    assert http.get(f"{path}/runs/mine").json()["estimator"]["steps"] == 10


def test_events_tell_a_job_to_its_end(http: httpx.Client, path: str):
    job = http.post(f"{path}/runs", json=QUICK).json()["job"]
    events = http.get(f"v1/jobs/{job}/events", headers={"Accept": "text/event-stream"})
    lines = [line for line in events.text.splitlines() if line.startswith("data: ")]
    states = [json.loads(line.removeprefix("data: "))["state"] for line in lines]
    assert states[-1] == "succeeded"
    assert states == sorted(states, key=["queued", "running", "succeeded"].index)


def test_a_running_job_is_cancelled_and_leaves_nothing(
    http: httpx.Client, own: sd.Dataset, path: str
):
    job = http.post(f"{path}/runs", json={**LONG, "run": "never"}).json()["job"]
    running(http, job)
    http.post(f"v1/jobs/{job}/cancel")
    assert ended(http, job)["state"] == "cancelled"
    assert own.runs.names() == ["vae"]
    assert http.post(f"v1/jobs/{job}/cancel").json()["state"] == "cancelled"


def test_a_full_queue_refuses_with_a_time_to_wait(folder: Path):
    with embed(folder, jobs=1, job_queue=0, grace_seconds=0.1) as store:
        client = store.connection.client
        job = client.post(RUNS, json=LONG).json()["job"]
        refused = client.post(RUNS, json=LONG)
        assert refused.status_code == 429
        assert int(refused.headers["retry-after"]) >= 1
        client.post(f"v1/jobs/{job}/cancel")


def test_a_job_that_takes_too_long_is_stopped(folder: Path):
    with embed(folder, jobs=1, job_seconds=3) as store:
        client = store.connection.client
        done = ended(client, client.post(RUNS, json=LONG).json()["job"])
        assert (done["state"], done["error"]["kind"]) == ("failed", "TimeoutError")


def test_a_job_that_takes_too_much_memory_fails_alone(folder: Path):
    huge = {"kind": "vae", "hidden": 1_000_000, "latent": 1_000_000, "steps": 1}
    with embed(folder, jobs=1, job_bytes=2**31) as store:
        client = store.connection.client
        done = ended(client, client.post(RUNS, json={"estimator": huge}).json()["job"])
        assert done["state"] == "failed"
        done = ended(client, client.post(RUNS, json=QUICK).json()["job"])
        assert done["state"] == "succeeded"


def test_a_job_is_made_once_under_one_key(http: httpx.Client, path: str):
    key = {"Idempotency-Key": "only-once"}
    first = http.post(f"{path}/runs", json=QUICK, headers=key).json()["job"]
    assert http.post(f"{path}/runs", json=QUICK, headers=key).json()["job"] == first
    other = http.post(f"{path}/runs", json={**QUICK, "seed": 1}, headers=key)
    assert other.status_code == 409
    ended(http, first)


def test_a_named_run_asked_for_again_after_its_success_is_the_same_job(
    http: httpx.Client, own: sd.Dataset, path: str
):
    key = {"Idempotency-Key": "once-for-all"}
    body = {**QUICK, "run": "mine"}
    first = ended(http, http.post(f"{path}/runs", json=body, headers=key).json()["job"])
    own.append([drive(9, 5)])
    again = http.post(f"{path}/runs", json=body, headers=key)
    assert (again.status_code, again.json()) == (202, first)
    assert first["state"] == "succeeded"
    assert http.post(f"{path}/runs", json=body).status_code == 409
    versions = own.versions
    for version in versions:
        other = http.post(f"{path}/runs", json={**body, "version": version}, headers=key)
        assert other.status_code == 409
    assert http.delete(path).status_code == 204
    assert http.post(f"{path}/runs", json=body, headers=key).json() == first


def test_a_request_is_the_same_job_for_every_server_of_the_store(folder: Path):
    key = {"Idempotency-Key": "to-whichever"}
    with embed(folder, jobs=1) as first, embed(folder, jobs=1) as second:
        clients = [first.connection.client, second.connection.client]
        answers = [each.post(RUNS, json=QUICK, headers=key).json() for each in clients]
        assert answers[0]["job"] == answers[1]["job"]
        done = ended(clients[1], answers[0]["job"])
    with embed(folder, jobs=1) as third:
        assert third.connection.client.post(RUNS, json=QUICK, headers=key).json() == done
    assert sd.Store(folder)["drives"].runs.names() == ["vae", "vae-2"]


def test_a_job_has_its_runs_name_when_it_is_accepted(http: httpx.Client, path: str):
    waiting = [http.post(f"{path}/runs", json=body).json() for body in (LONG, QUICK, LONG)]
    assert [job["run"] for job in waiting] == ["vae-2", "vae-3", "vae-4"]
    assert http.post(f"{path}/runs", json={**QUICK, "run": "vae-3"}).status_code == 409
    for job in (waiting[2], waiting[0]):
        http.post(f"v1/jobs/{job['job']}/cancel")
    assert ended(http, waiting[1]["job"])["run"] == "vae-3"
    assert http.post(f"{path}/runs", json=QUICK).json()["run"] == "vae-2"


def test_a_dataset_is_not_deleted_under_a_running_job(http: httpx.Client, path: str):
    job = http.post(f"{path}/runs", json=LONG).json()["job"]
    running(http, job)
    assert http.delete(path).status_code == 409
    http.post(f"v1/jobs/{job}/cancel")
    ended(http, job)
    assert http.delete(path).status_code == 204
    assert http.get(f"{path}/runs").status_code == 404


def test_a_name_in_use_and_settings_that_are_none_are_refused_at_once(
    http: httpx.Client, path: str
):
    assert http.post(f"{path}/runs", json={**QUICK, "run": "vae"}).status_code == 409
    for wrong in (
        {"estimator": {"kind": "nope"}},
        {"estimator": {"kind": "vae", "steps": -1}},
        {"estimator": {"kind": "vae", "surprise": 1}},
        {"estimator": {"kind": "vae"}, "scale": {"kind": "quantile", "low": 0.9, "high": 0.1}},
        {"estimator": {"kind": "vae"}, "run": "../up"},
        {"estimators": {"kind": "vae"}},
    ):
        assert http.post(f"{path}/runs", json=wrong).status_code == 422, wrong
    assert http.post(f"{path}/runs", json={"fitted": {"run": "nope"}}).status_code == 404


def test_a_killed_server_leaves_failed_and_waiting_jobs_to_the_next(folder: Path, serve: Serve):
    first = serve(folder, "--jobs", "1")
    with httpx.Client(base_url=first.url) as http:
        done = http.post(RUNS, json={**QUICK, "run": "done"}).json()["job"]
        ended(http, done)
        cut = http.post(RUNS, json={**LONG, "run": "cut"}).json()["job"]
        running(http, cut)
        waiting = http.post(RUNS, json={**QUICK, "run": "waiting"}).json()["job"]
    first.kill()
    second = serve(folder, "--jobs", "1")
    with httpx.Client(base_url=second.url) as http:
        assert http.get(f"v1/jobs/{done}").json()["run"] == "done"
        found = ended(http, cut)
        assert (found["state"], found["error"]["kind"]) == ("failed", "ServerStoppedError")
        assert ended(http, waiting)["run"] == "waiting"
        assert len(http.get("v1/jobs").json()["jobs"]) == 3
    assert sd.Store(folder)["drives"].runs.names() == ["done", "vae", "waiting"]
    assert sd.Store(folder)["drives"].find_damage() == []


def test_two_servers_share_a_store(folder: Path, serve: Serve):
    servers = [serve(folder, "--jobs", "1") for _ in range(2)]
    stores: list[RemoteStore] = [connect(server.url) for server in servers]
    runs = [store["drives"].score(sd.VAE(steps=10), seed=3).name for store in stores]
    assert runs == ["vae-2", "vae-3"]
    for store in stores:
        assert sorted(store["drives"].runs.names()) == ["vae", *runs]
    assert len(stores[0].connection.json("GET", "v1/jobs")["jobs"]) == 2
    stores[0].create(
        "other",
        [sd.Episode([[1.0], [2.0]], [[0.0], [1.0]])],
        state_names=["x"],
        action_names=["a"],
    )
    assert stores[1].names() == ["drives", "other"]
    stores[1].delete("other")
    assert "other" not in stores[0]
    for store in stores:
        store.close()


def test_an_orderly_end_finishes_what_was_accepted(folder: Path, serve: Serve):
    server = serve(folder, "--jobs", "1")
    with httpx.Client(base_url=server.url) as http:
        job = http.post(RUNS, json={**QUICK, "run": "last"}).json()["job"]
        running(http, job)
    assert server.stop() == 0
    assert sd.Store(folder)["drives"].runs["last"].name == "last"
    assert list((folder / ".service" / "servers").iterdir()) == []


@pytest.mark.parametrize("job", ["0" * 16, "f" * 16])
def test_an_unknown_job_is_not_found(job: str, http: httpx.Client):
    assert http.get(f"v1/jobs/{job}").status_code == 404
    assert http.post(f"v1/jobs/{job}/cancel").status_code == 404
