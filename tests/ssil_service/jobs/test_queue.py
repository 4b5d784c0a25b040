"""The job queue: whatever a job, a worker or the disk does, the next job runs."""

import json
import logging
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import ssil_data as sd
from ssil_service import embed
from ssil_service.jobs.journal import KEPT, JobRecord, Journal
from ssil_service.jobs.queue import JobQueue, JobRequest
from ssil_service.jobs.runner import Runner
from ssil_service.problems import Problem
from ssil_service.workers.lease import ServerLease
from ssil_service.workers.pool import Pool
from ssil_service.workers.tasks import make_run
from ssil_service.workers.worker import TaskError, Worker

Work = Callable[..., Any]
POPEN = "ssil_service.workers.worker.subprocess.Popen"


class Scripted:
    """A pool whose tasks are functions, one after another, in the thread that runs them."""

    def __init__(self, *works: Work) -> None:
        self.works = list(works)

    def run(self, task: str, arguments: dict[str, Any], **callbacks: Any) -> Any:
        return self.works.pop(0)(report=lambda *step: None, **arguments)

    def close(self) -> None:
        pass


def crash(**arguments: Any) -> None:
    raise TaskError("CrashError", "the process ended with status -9")


def nothing(**arguments: Any) -> None:
    pass


def job_request(folder: Path, run: str | None = None, **body: Any) -> JobRequest:
    settings = sd.VAE(steps=20)
    fit = {
        "estimator": {"kind": "vae", **vars(settings)},
        "scale": {"kind": "quantile", "low": 0.05, "high": 0.95},
        "labeled_is_one": False,
        "seed": 0,
    }
    version = sd.Store(folder)["drives"].version
    return JobRequest(
        dataset="drives",
        version=version,
        body=body or fit,
        run_name=run,
        name_prefix="vae",
        request_digest=f"{run} {body}",
    )


def make_queue(folder: Path, *works: Work, running: int = 1) -> JobQueue:
    """Return a queue that is not started, of a server of its own."""
    pool: Any = Scripted(*works)
    lease = ServerLease(folder / ".service")
    return JobQueue(str(folder), lease, pool, running=running, waiting=8)


def leave_job(folder: Path, run: str | None = None) -> dict[str, Any]:
    """Submit a job to a server that dies before it runs."""
    dead = make_queue(folder)
    job = dead.submit(job_request(folder, run), None)
    dead.lease.release()
    return job


@pytest.fixture
def start(folder: Path) -> Iterator[Callable[..., JobQueue]]:
    """Start job queues on one store, each of a server of its own."""
    queues: list[JobQueue] = []

    def start(*works: Work, running: int = 1) -> JobQueue:
        queues.append(make_queue(folder, *works, running=running))
        queues[-1].start()
        return queues[-1]

    yield start
    for each in queues:
        each.close(5)
        each.lease.close()


def wait_for_end(queue: JobQueue, job: dict[str, Any]) -> dict[str, Any]:
    deadline = time.monotonic() + 20
    while (found := queue.get(job["job"]))["state"] in ("queued", "running"):
        assert time.monotonic() < deadline, found
        time.sleep(0.01)
    return found


def run_both(first: Work, then: Work) -> Work:
    def both(**arguments: Any) -> None:
        first(**arguments)
        then(**arguments)

    return both


# names


@pytest.mark.parametrize("body", [{}, {"fitted": {"dataset": None, "run": "vae"}}])
def test_a_job_that_crashed_does_not_claim_the_run_of_somebody_else(
    body: dict[str, Any], folder: Path, start: Callable[..., JobQueue]
):
    """Somebody makes the same run, under another name, while the job runs and dies."""

    def another(**arguments: Any) -> None:
        make_run(**{**arguments, "run": "another"})

    queue = start(run_both(another, crash))
    done = wait_for_end(queue, queue.submit(job_request(folder, None, **body), None))
    assert (done["state"], done["error"]["kind"]) == ("failed", "CrashError")
    assert "another" in sd.Store(folder)["drives"].runs.names()


@pytest.mark.parametrize("body", [{}, {"fitted": {"dataset": None, "run": "vae"}}])
def test_a_job_that_crashed_after_its_commit_has_succeeded(
    body: dict[str, Any], folder: Path, start: Callable[..., JobQueue]
):
    queue = start(run_both(make_run, crash))
    done = wait_for_end(queue, queue.submit(job_request(folder, None, **body), None))
    assert (done["state"], done["run"], done["error"]) == ("succeeded", "vae-2", None)


def test_a_run_of_the_jobs_name_with_other_settings_is_not_the_jobs(
    folder: Path, start: Callable[..., JobQueue]
):
    def otherwise(**arguments: Any) -> None:
        sd.score(sd.Store(folder)["drives"], sd.VAE(steps=5), run=arguments["run"])

    queue = start(run_both(otherwise, crash))
    assert wait_for_end(queue, queue.submit(job_request(folder), None))["state"] == "failed"


def test_a_refused_job_claims_nothing(folder: Path, start: Callable[..., JobQueue]):
    """The name is taken by somebody who did just the same: that is a conflict all the same."""
    queue = start(run_both(make_run, make_run))
    done = wait_for_end(queue, queue.submit(job_request(folder, "mine"), None))
    assert (done["state"], done["error"]["kind"]) == ("failed", "ConflictError")


def test_a_job_whose_automatic_name_was_taken_meanwhile_gets_another(
    folder: Path, start: Callable[..., JobQueue]
):
    queue = start(run_both(make_run, make_run), make_run)
    job = queue.submit(job_request(folder), None)
    assert job["run"] == "vae-2"
    done = wait_for_end(queue, job)
    assert (done["state"], done["run"]) == ("succeeded", "vae-3")


def test_a_job_whose_automatic_name_was_taken_while_it_waited_starts_under_another(
    folder: Path, start: Callable[..., JobQueue]
):
    job = leave_job(folder)
    sd.score(sd.Store(folder)["drives"], sd.VAE(steps=5), run="vae-2")
    queue = start(make_run)
    assert wait_for_end(queue, job)["run"] == "vae-3"


def test_jobs_of_two_servers_get_different_names(folder: Path, start: Callable[..., JobQueue]):
    first = start(running=0)
    second = start(running=0)
    names = [queue.submit(job_request(folder), None)["run"] for queue in (first, second, first)]
    assert names == ["vae-2", "vae-3", "vae-4"]
    with pytest.raises(sd.ConflictError, match="reserved"):
        second.submit(job_request(folder, "vae-4"), None)


# what fails


def refuse_writes(monkeypatch: pytest.MonkeyPatch, refuses: Callable[[JobRecord], bool]) -> None:
    write = Journal.write

    def refused(self: Journal, record: JobRecord) -> None:
        if refuses(record):
            raise OSError(28, "no space left on device")
        write(self, record)

    monkeypatch.setattr(Journal, "write", refused)


@pytest.mark.parametrize("state", ["running", "succeeded"])
def test_a_journal_that_cannot_be_written_does_not_stop_the_queue(
    state: str, folder: Path, start: Callable[..., JobQueue], monkeypatch: pytest.MonkeyPatch
):
    queue = start(make_run, make_run)
    with monkeypatch.context() as patch:
        refuse_writes(patch, lambda record: record.state == state)
        done = wait_for_end(queue, queue.submit(job_request(folder, "first"), None))
        assert done["state"] == ("failed" if state == "running" else "succeeded")
        assert "space" not in json.dumps(done)
    assert (
        wait_for_end(queue, queue.submit(job_request(folder, "second"), None))["state"]
        == "succeeded"
    )
    kept = {record.run_name: record.state for record in Journal(folder / ".service" / "jobs").all()}
    assert kept == {"first": done["state"], "second": "succeeded"}


@pytest.mark.parametrize("what", ["submit", "cancel"])
def test_nothing_is_acknowledged_that_is_not_in_the_journal(
    what: str, folder: Path, start: Callable[..., JobQueue], monkeypatch: pytest.MonkeyPatch
):
    queue = start(running=0)
    job = queue.submit(job_request(folder), None)
    refuse_writes(monkeypatch, lambda record: True)
    with pytest.raises(Problem) as refused:
        queue.submit(job_request(folder), None) if what == "submit" else queue.cancel(job["job"])
    assert refused.value.status == 503
    assert [each["state"] for each in queue.all()] == ["queued"]


def test_any_error_of_a_job_fails_that_job_alone(folder: Path, start: Callable[..., JobQueue]):
    def odd(**arguments: Any) -> None:
        raise ZeroDivisionError("/a/place/on/the/machine")

    queue = start(odd, nothing)
    jobs = [queue.submit(job_request(folder), None) for _ in range(2)]
    assert wait_for_end(queue, jobs[0])["error"] == {
        "kind": "InternalError",
        "detail": "the service failed (ZeroDivisionError)",
    }
    assert wait_for_end(queue, jobs[1])["state"] == "succeeded"


def test_a_worker_that_cannot_be_started_fails_its_task_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    lease = ServerLease(folder / ".service")
    workers = Pool(lease.lock, 2**33, 60)

    def refuse(*command: Any, **options: Any) -> Any:
        raise BlockingIOError(11, "resource temporarily unavailable")

    with monkeypatch.context() as patch:
        patch.setattr(POPEN, refuse)
        with pytest.raises(TaskError) as failed:
            workers.run("decode", {})
    assert failed.value.kind == "StartError"
    with pytest.raises(TaskError) as failed:  # the pool is not blocked: the next one is started
        workers.run("nothing", {})
    assert failed.value.kind == "InternalError"
    workers.close()
    lease.close()


class Answering:
    """A worker that answers at once."""

    def __init__(self) -> None:
        self.killed = False

    def run(self, task: str, arguments: Any, **options: Any) -> str:
        return task

    def kill_soon(self) -> None:
        self.killed = True

    @property
    def alive(self) -> bool:
        return True


def test_a_worker_is_released_before_it_is_idle(tmp_path: Path):
    def start_worker(lock: Path, memory_limit: int) -> Any:
        return Answering()

    workers = Pool(tmp_path / "lock", 2**33, 60, keep=1, start_worker=start_worker)
    calls: list[tuple[bool, int]] = []

    def assign_worker(worker: Worker | None) -> None:
        calls.append((worker is None, workers.idle_count))

    workers.run("x", {}, assign_worker=assign_worker)
    assert calls == [(False, 0), (True, 0)]
    assert workers.idle_count == 1


def test_a_worker_that_was_killed_is_not_kept(folder: Path):
    """The signal is on its way, and the process still runs and answers."""
    lease = ServerLease(folder / ".service")
    workers = Pool(lease.lock, 2**33, 60, keep=1)
    known: list[Worker] = []

    def kill_without_signal(worker: Worker | None) -> None:
        if worker is not None:
            known.append(worker)
            kill = worker._process.kill
            worker._process.kill = lambda: None
            worker.kill_soon()
            worker._process.kill = kill

    with pytest.raises(TaskError, match="the task failed"):
        workers.run("nothing", {}, assign_worker=kill_without_signal)
    assert workers.idle_count == 0
    assert known[0]._process.returncode is not None
    lease.close()


def test_canceling_a_job_whose_worker_was_released_kills_no_worker(
    folder: Path, start: Callable[..., JobQueue], monkeypatch: pytest.MonkeyPatch
):
    worker = Answering()
    done = threading.Event()
    go_on = threading.Event()

    class Lending(Scripted):
        def run(self, task: str, arguments: dict[str, Any], **callbacks: Any) -> Any:
            callbacks["assign_worker"](worker)
            callbacks["assign_worker"](None)

    def wait(self: JobQueue, *found: Any) -> bool:
        done.set()
        return not go_on.wait(20)

    monkeypatch.setattr(JobQueue, "_needs_another_name", wait)
    queue = start()
    queue.runner = replace(queue.runner, pool=Lending())  # pyright: ignore[reportArgumentType]
    job = queue.submit(job_request(folder), None)
    assert done.wait(20)
    queue.cancel(job["job"])
    go_on.set()
    assert wait_for_end(queue, job)["state"] == "succeeded"
    assert not worker.killed


def test_what_a_worker_wrote_before_it_was_killed_is_still_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Its commit is known, so that no client is answered as if nothing had been changed."""
    popen = subprocess.Popen
    lines = '{"progress": 1}\n{"phase": "writing"}\n{"progress": 2}\n{"result": 3}\n'
    code = f"import sys, time; sys.stdout.write({lines!r}); sys.stdout.flush(); time.sleep(60)"
    monkeypatch.setattr(POPEN, lambda _, **how: popen([sys.executable, "-c", code], **how))
    workers = Pool(tmp_path, 2**30, 60)
    messages: list[Any] = []

    def report(progress: Any) -> None:
        messages.append(progress)
        if progress == 1:
            workers.close()

    assert workers.run("x", {}, report=report, enter_phase=messages.append) == 3
    assert messages == [1, "writing", 2]


@pytest.mark.parametrize(
    "line", ['{"progress": {"wh', "{}\n", "[1]\n", "\xff\n", "[" * 10**5 + "\n", ""]
)
def test_a_line_that_a_worker_did_not_finish_counts_as_a_crash(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    popen = subprocess.Popen
    code = f"import sys; sys.stdout.buffer.write({line.encode('latin-1')!r})"

    def torn(command: list[str], **options: Any) -> Any:
        return popen([sys.executable, "-c", code], **options)

    monkeypatch.setattr(POPEN, torn)
    worker = Worker(tmp_path, 2**30)
    with pytest.raises(TaskError) as failed:
        worker.run("decode", {}, seconds=60)
    assert failed.value.kind == "CrashError"
    worker.kill()


# the journal


@pytest.mark.parametrize(
    "content", [b"", b"{", b"\xff", b"[]", b"null", b'{"job": "x"}', b"[" * 10**5, None]
)
def test_a_file_that_holds_no_record_is_skipped_and_logged(
    content: bytes | None, folder: Path, caplog: pytest.LogCaptureFixture
):
    jobs = folder / ".service" / "jobs"
    jobs.mkdir(parents=True)
    odd = jobs / f"{'a' * 16}.json"
    odd.mkdir() if content is None else odd.write_bytes(content)
    (jobs / "notes.json").write_text("{}")
    (folder / ".service" / "servers").mkdir()
    (folder / ".service" / "servers" / "notes").write_text("no server's place")
    with caplog.at_level(logging.WARNING, "ssil_service"), embed(folder, jobs=1) as store:
        http = store.connection.client
        assert http.get("v1/jobs").json() == {"jobs": []}
        assert http.get(f"v1/jobs/{'a' * 16}").status_code == 404
    assert [record.getMessage() for record in caplog.records] == ["invalid job record"]
    assert odd.exists()


def test_a_record_with_a_field_of_another_type_is_none(
    folder: Path, start: Callable[..., JobQueue]
):
    queue = start(running=0)
    job = queue.submit(job_request(folder), None)["job"]
    path = folder / ".service" / "jobs" / f"{job}.json"
    record = json.loads(path.read_text())
    for field, value in (("state", "odd"), ("created", 3), ("body", "text"), ("job", "b" * 16)):
        path.write_text(json.dumps({**record, field: value}))
        assert Journal(path.parent).all() == []
    path.write_text(json.dumps(record))
    assert [each.id for each in Journal(path.parent).all()] == [job]


@pytest.mark.parametrize(
    "change",
    [
        {"body": {}},
        {"body": {"fitted": {}}},
        {"body": {"fitted": 3}},
        {"dataset": "../x"},
        {"dataset": "nope"},
        {"run": "../x"},
        {"run": ""},
    ],
)
@pytest.mark.parametrize("state", ["queued", "running"])
def test_an_odd_record_of_a_dead_server_fails_alone(
    state: str, change: dict[str, Any], folder: Path, start: Callable[..., JobQueue]
):
    odd = leave_job(folder, "vae-9")
    good = leave_job(folder, "good")
    path = folder / ".service" / "jobs" / f"{odd['job']}.json"
    if "run" not in change and "dataset" not in change:
        stored = json.loads(path.read_text())
        arguments = {name: stored[name] for name in ("dataset", "version", "run", "body")}
        make_run(store=str(folder), **arguments, report=lambda *step: None)
    path.write_text(json.dumps({**json.loads(path.read_text()), **change, "state": state}))
    works = [make_run, make_run] if state == "queued" else [make_run]
    queue = start(*works)
    assert wait_for_end(queue, odd)["state"] == "failed"
    assert wait_for_end(queue, good)["state"] == "succeeded"
    assert Journal(path.parent).get(odd["job"]) is not None


def test_an_error_while_a_job_is_adopted_fails_that_job_alone(
    folder: Path,
    start: Callable[..., JobQueue],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
):
    job = leave_job(folder)["job"]
    journal = Journal(folder / ".service" / "jobs")
    record = journal.get(job)
    assert record is not None
    journal.write(replace(record, state="running"))

    def odd(*found: Any) -> None:
        raise ZeroDivisionError("/a/place/on/the/machine")

    monkeypatch.setattr(Runner, "find_ending", odd)
    with caplog.at_level(logging.ERROR, "ssil_service"):
        queue = start(running=0)
    assert queue.get(job)["error"] == {
        "kind": "InternalError",
        "detail": "the service failed (ZeroDivisionError)",
    }
    assert [each.getMessage() for each in caplog.records] == ["job failed"]
    kept = Journal(folder / ".service" / "jobs").get(job)
    assert kept is not None and kept.state == "failed"


def test_a_queued_job_that_cannot_be_adopted_is_left_to_the_next_server(
    folder: Path, start: Callable[..., JobQueue], monkeypatch: pytest.MonkeyPatch
):
    job = leave_job(folder)
    with monkeypatch.context() as patch:
        refuse_writes(patch, lambda record: True)
        assert start(running=0).get(job["job"])["state"] == "queued"
    assert wait_for_end(start(make_run), job)["state"] == "succeeded"


def test_the_journal_keeps_the_newest_ended_jobs(
    folder: Path, start: Callable[..., JobQueue], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("ssil_service.jobs.registry.KEPT", 3)
    assert KEPT == 1000
    queue = start(*[nothing] * 5)
    jobs = [queue.submit(job_request(folder), f"key-{number}") for number in range(5)]
    for job in jobs[2:]:
        wait_for_end(queue, job)
    files = {path.stem for path in (folder / ".service" / "jobs").iterdir()}
    assert files == {job["job"] for job in jobs[2:]}
    assert len(queue.all()) == 3
    assert queue.find_repeated("key-0", job_request(folder).request_digest) is None
    assert queue.find_repeated("key-4", job_request(folder).request_digest) == queue.get(
        jobs[4]["job"]
    )


def test_a_job_of_a_server_whose_folder_is_gone_is_adopted(
    folder: Path, start: Callable[..., JobQueue]
):
    dead = make_queue(folder)
    job = dead.submit(job_request(folder), None)
    dead.lease.close()
    queue = start(make_run)
    assert wait_for_end(queue, job)["state"] == "succeeded"
