"""The board of jobs: whatever a job, a worker or the disk does, the next job runs."""

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
from ssil_service.jobs import journal
from ssil_service.jobs.journal import JobRecord, Journal
from ssil_service.jobs.queue import JobQueue, JobRequest
from ssil_service.jobs.runner import Runner
from ssil_service.problems import Problem
from ssil_service.workers import pool
from ssil_service.workers.lease import ServerLease
from ssil_service.workers.pool import Pool, TaskError, Worker
from ssil_service.workers.tasks import make_run

Work = Callable[..., Any]


class Scripted:
    """A pool whose tasks are done by functions in turn, in the thread that asks."""

    def __init__(self, *works: Work) -> None:
        self.works = list(works)

    def run(self, task: str, arguments: dict[str, Any], **told: Any) -> Any:
        return self.works.pop(0)(report=lambda *step: None, **arguments)

    def close(self) -> None:
        pass


def crash(**arguments: Any) -> None:
    raise TaskError("CrashError", "the process ended with status -9")


def nothing(**arguments: Any) -> None:
    pass


def order(folder: Path, run: str | None = None, **body: Any) -> JobRequest:
    settings = sd.VAE(steps=20)
    fit = {
        "estimator": {"kind": "vae", **vars(settings)},
        "scale": {"kind": "quantile", "low": 0.05, "high": 0.95},
        "labeled_is_one": False,
        "seed": 0,
    }
    version = sd.Store(folder)["drives"].version
    return JobRequest("drives", version, body or fit, run, "vae", f"{run} {body}")


@pytest.fixture
def opened(folder: Path) -> Iterator[Callable[..., JobQueue]]:
    """Boards on one store, each of a server of its own."""
    boards: list[JobQueue] = []

    def board(*works: Work, running: int = 1, server: ServerLease | None = None) -> JobQueue:
        state = server or ServerLease(folder / ".service")
        boards.append(JobQueue(str(folder), state, Scripted(*works), running, 8))
        boards[-1].start()
        return boards[-1]

    yield board
    for each in boards:
        each.close(5)
        each.state.close()


def ended(board: JobQueue, job: dict[str, Any]) -> dict[str, Any]:
    deadline = time.monotonic() + 20
    while (found := board.get(job["job"]))["state"] in ("queued", "running"):
        assert time.monotonic() < deadline, found
        time.sleep(0.01)
    return found


def after(first: Work, then: Work) -> Work:
    def both(**arguments: Any) -> None:
        first(**arguments)
        then(**arguments)

    return both


# names


@pytest.mark.parametrize("body", [{}, {"fitted": {"dataset": None, "run": "vae"}}])
def test_a_job_that_was_cut_off_does_not_claim_anothers_run(
    body: dict[str, Any], folder: Path, opened: Callable[..., JobQueue]
):
    """Somebody makes the same run, under another name, while the job runs and dies."""

    def another(**arguments: Any) -> None:
        make_run(**{**arguments, "run": "another"})

    board = opened(after(another, crash))
    done = ended(board, board.submit(order(folder, None, **body), None))
    assert (done["state"], done["error"]["kind"]) == ("failed", "CrashError")
    assert "another" in sd.Store(folder)["drives"].runs.names()


@pytest.mark.parametrize("body", [{}, {"fitted": {"dataset": None, "run": "vae"}}])
def test_a_job_that_was_cut_off_after_its_commit_has_succeeded(
    body: dict[str, Any], folder: Path, opened: Callable[..., JobQueue]
):
    board = opened(after(make_run, crash))
    done = ended(board, board.submit(order(folder, None, **body), None))
    assert (done["state"], done["run"], done["error"]) == ("succeeded", "vae-2", None)


def test_a_run_of_that_name_that_was_made_otherwise_is_not_the_jobs(
    folder: Path, opened: Callable[..., JobQueue]
):
    def otherwise(**arguments: Any) -> None:
        sd.score(sd.Store(folder)["drives"], sd.VAE(steps=5), run=arguments["run"])

    board = opened(after(otherwise, crash))
    assert ended(board, board.submit(order(folder), None))["state"] == "failed"


def test_a_refused_job_claims_nothing(folder: Path, opened: Callable[..., JobQueue]):
    """The name is taken by somebody who did just the same: that is a conflict all the same."""
    board = opened(after(make_run, make_run))
    done = ended(board, board.submit(order(folder, "mine"), None))
    assert (done["state"], done["error"]["kind"]) == ("failed", "ConflictError")


def test_an_automatic_name_that_somebody_outside_took_is_given_up_for_another(
    folder: Path, opened: Callable[..., JobQueue]
):
    board = opened(after(make_run, make_run), make_run)
    job = board.submit(order(folder), None)
    assert job["run"] == "vae-2"
    done = ended(board, job)
    assert (done["state"], done["run"]) == ("succeeded", "vae-3")


def test_a_name_taken_while_the_job_waited_is_given_up_before_it_starts(
    folder: Path, opened: Callable[..., JobQueue]
):
    dead = JobQueue(str(folder), ServerLease(folder / ".service"), Scripted(), 1, 8)
    job = dead.submit(order(folder), None)
    dead.state.release()
    sd.score(sd.Store(folder)["drives"], sd.VAE(steps=5), run="vae-2")
    board = opened(make_run)
    assert ended(board, job)["run"] == "vae-3"


def test_no_two_jobs_of_any_servers_have_one_name(folder: Path, opened: Callable[..., JobQueue]):
    first, second = opened(running=0), opened(running=0)
    names = [board.submit(order(folder), None)["run"] for board in (first, second, first)]
    assert names == ["vae-2", "vae-3", "vae-4"]
    with pytest.raises(sd.ConflictError, match="reserved"):
        second.submit(order(folder, "vae-4"), None)


# what fails


def refusing(monkeypatch: pytest.MonkeyPatch, refuses: Callable[[JobRecord], bool]) -> None:
    write = Journal.write

    def refused(self: Journal, record: JobRecord) -> None:
        if refuses(record):
            raise OSError(28, "no space left on device")
        write(self, record)

    monkeypatch.setattr(Journal, "write", refused)


@pytest.mark.parametrize("state", ["running", "succeeded"])
def test_a_journal_that_cannot_be_written_does_not_stop_the_queue(
    state: str, folder: Path, opened: Callable[..., JobQueue], monkeypatch: pytest.MonkeyPatch
):
    board = opened(make_run, make_run)
    with monkeypatch.context() as patch:
        refusing(patch, lambda record: record.state == state)
        done = ended(board, board.submit(order(folder, "first"), None))
        assert done["state"] == ("failed" if state == "running" else "succeeded")
        assert "space" not in json.dumps(done)
    assert ended(board, board.submit(order(folder, "second"), None))["state"] == "succeeded"
    kept = {record.run: record.state for record in Journal(folder / ".service" / "jobs").all()}
    assert kept == {"first": done["state"], "second": "succeeded"}


@pytest.mark.parametrize("what", ["submit", "cancel"])
def test_nothing_is_acknowledged_that_is_not_in_the_journal(
    what: str, folder: Path, opened: Callable[..., JobQueue], monkeypatch: pytest.MonkeyPatch
):
    board = opened(running=0)
    job = board.submit(order(folder), None)
    refusing(monkeypatch, lambda record: True)
    with pytest.raises(Problem) as refused:
        board.submit(order(folder), None) if what == "submit" else board.cancel(job["job"])
    assert refused.value.status == 503
    assert [each["state"] for each in board.all()] == ["queued"]


def test_any_error_of_a_job_is_its_own(folder: Path, opened: Callable[..., JobQueue]):
    def odd(**arguments: Any) -> None:
        raise ZeroDivisionError("/a/place/on/the/machine")

    board = opened(odd, nothing)
    jobs = [board.submit(order(folder), None) for _ in range(2)]
    assert ended(board, jobs[0])["error"] == {
        "kind": "InternalError",
        "detail": "the service failed (ZeroDivisionError)",
    }
    assert ended(board, jobs[1])["state"] == "succeeded"


def test_a_worker_that_cannot_be_started_fails_its_task_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    state = ServerLease(folder / ".service")
    workers = Pool(state.lock, 2**33, 60)

    def refused(*command: Any, **options: Any) -> Any:
        raise BlockingIOError(11, "resource temporarily unavailable")

    with monkeypatch.context() as patch:
        patch.setattr(pool.subprocess, "Popen", refused)
        with pytest.raises(TaskError) as failed:
            workers.run("decode", {})
    assert failed.value.kind == "StartError"
    with pytest.raises(TaskError) as failed:  # nothing is held, and the next one is started
        workers.run("nothing", {})
    assert failed.value.kind == "InternalError"
    workers.close()
    state.close()


class Answering:
    """A worker that answers at once."""

    def __init__(self) -> None:
        self.killed = False

    def run(self, task: str, *arguments: Any) -> str:
        return task

    def kill_soon(self) -> None:
        self.killed = True

    @property
    def alive(self) -> bool:
        return True


def test_a_worker_is_let_go_of_before_it_is_idle(tmp_path: Path):
    workers = Pool(tmp_path / "lock", 2**33, 60, keep=1)
    workers._new = Answering  # pyright: ignore[reportAttributeAccessIssue]
    told: list[tuple[bool, int]] = []
    workers.run("x", {}, started=lambda worker: told.append((worker is None, len(workers._idle))))
    assert (told, len(workers._idle)) == ([(False, 0), (True, 0)], 1)


def test_a_worker_that_was_killed_is_not_kept(folder: Path):
    """The kill is on its way, and the process has not heard of it yet."""
    state = ServerLease(folder / ".service")
    workers = Pool(state.lock, 2**33, 60, keep=1)
    known: list[Worker] = []

    def started(worker: Worker | None) -> None:
        if worker is not None:
            known.append(worker)
            worker._process.kill, kill = lambda: None, worker._process.kill
            worker.kill_soon()
            worker._process.kill = kill

    with pytest.raises(TaskError, match="the task failed"):
        workers.run("nothing", {}, started=started)
    assert not workers._idle and known[0]._process.returncode is not None
    state.close()


def test_cancelling_a_job_whose_worker_is_done_kills_nobody(
    folder: Path, opened: Callable[..., JobQueue], monkeypatch: pytest.MonkeyPatch
):
    worker, done, go_on = Answering(), threading.Event(), threading.Event()

    class Lending(Scripted):
        def run(self, task: str, arguments: dict[str, Any], **told: Any) -> Any:
            told["started"](worker)
            told["started"](None)

    def slow(self: JobQueue, *found: Any) -> bool:
        done.set()
        return not go_on.wait(20)

    monkeypatch.setattr(JobQueue, "_claimed_elsewhere", slow)
    board = opened()
    board.runner = replace(board.runner, pool=Lending())  # pyright: ignore[reportArgumentType]
    job = board.submit(order(folder), None)
    assert done.wait(20)
    board.cancel(job["job"])
    go_on.set()
    assert ended(board, job)["state"] == "succeeded"
    assert not worker.killed


def test_what_a_worker_said_before_the_end_is_heard_although_it_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Its commit is known: nobody is told that nothing was begun."""
    start, lines = subprocess.Popen, '{"progress": 1}\n{"progress": 2}\n{"result": 3}\n'
    code = f"import sys, time; sys.stdout.write({lines!r}); sys.stdout.flush(); time.sleep(60)"
    monkeypatch.setattr(
        pool.subprocess, "Popen", lambda _, **how: start([sys.executable, "-c", code], **how)
    )
    workers, told = Pool(tmp_path, 2**30, 60), list[Any]()

    def report(progress: Any) -> None:
        told.append(progress)
        if progress == 1:
            workers.close()

    assert workers.run("x", {}, report=report) == 3
    assert told == [1, 2]


@pytest.mark.parametrize(
    "line", ['{"progress": {"wh', "{}\n", "[1]\n", "\xff\n", "[" * 10**5 + "\n", ""]
)
def test_a_line_that_a_worker_did_not_finish_is_its_death(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    start = subprocess.Popen
    code = f"import sys; sys.stdout.buffer.write({line.encode('latin-1')!r})"

    def torn(command: list[str], **options: Any) -> Any:
        return start([sys.executable, "-c", code], **options)

    monkeypatch.setattr(pool.subprocess, "Popen", torn)
    worker = Worker(tmp_path, 2**30)
    with pytest.raises(TaskError) as failed:
        worker.run("decode", {}, lambda progress: None, 60)
    assert failed.value.kind == "CrashError"
    worker.kill()


# the journal


@pytest.mark.parametrize(
    "content", [b"", b"{", b"\xff", b"[]", b"null", b'{"job": "x"}', b"[" * 10**5, None]
)
def test_what_is_no_record_is_left_out_and_told(
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
    assert [record.getMessage() for record in caplog.records] == ["no record of a job"]
    assert odd.exists()


def test_a_record_with_a_field_of_another_type_is_none(
    folder: Path, opened: Callable[..., JobQueue]
):
    board = opened(running=0)
    job = board.submit(order(folder), None)["job"]
    path = folder / ".service" / "jobs" / f"{job}.json"
    record = json.loads(path.read_text())
    for field, value in (("state", "odd"), ("created", 3), ("body", "text"), ("job", "b" * 16)):
        path.write_text(json.dumps({**record, field: value}))
        assert Journal(path.parent).all() == []
    path.write_text(json.dumps(record))
    assert [each.job for each in Journal(path.parent).all()] == [job]


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
    state: str, change: dict[str, Any], folder: Path, opened: Callable[..., JobQueue]
):
    dead = JobQueue(str(folder), ServerLease(folder / ".service"), Scripted(), 1, 8)
    odd, good = dead.submit(order(folder, "vae-9"), None), dead.submit(order(folder, "good"), None)
    dead.state.release()
    if "run" not in change and "dataset" not in change:
        make_run(**_arguments(folder, dead, odd), report=lambda *step: None)
    path = folder / ".service" / "jobs" / f"{odd['job']}.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change, "state": state}))
    works = [make_run, make_run] if state == "queued" else [make_run]
    board = opened(*works)
    assert ended(board, odd)["state"] == "failed"
    assert ended(board, good)["state"] == "succeeded"
    assert Journal(path.parent).read(odd["job"]) is not None


def _arguments(folder: Path, board: JobQueue, job: dict[str, Any]) -> dict[str, Any]:
    record = board.ledger.entries[job["job"]].record
    known = {"dataset": record.dataset, "version": record.version, "run": record.run}
    return {"store": str(folder), **known, "body": record.body}


def test_whatever_is_raised_while_a_job_is_taken_over_is_the_jobs_alone(
    folder: Path,
    opened: Callable[..., JobQueue],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
):
    dead = JobQueue(str(folder), ServerLease(folder / ".service"), Scripted(), 1, 8)
    job = dead.submit(order(folder), None)["job"]
    dead.state.journal.write(replace(dead.ledger.entries[job].record, state="running"))
    dead.state.release()

    def odd(*found: Any) -> None:
        raise ZeroDivisionError("/a/place/on/the/machine")

    monkeypatch.setattr(Runner, "find_ending", odd)
    with caplog.at_level(logging.ERROR, "ssil_service"):
        board = opened(running=0)
    assert board.get(job)["error"] == {
        "kind": "InternalError",
        "detail": "the service failed (ZeroDivisionError)",
    }
    assert [each.getMessage() for each in caplog.records] == ["job failed"]
    kept = Journal(folder / ".service" / "jobs").read(job)
    assert kept is not None and kept.state == "failed"


def test_a_queued_job_that_cannot_be_taken_over_is_left_to_the_next_server(
    folder: Path, opened: Callable[..., JobQueue], monkeypatch: pytest.MonkeyPatch
):
    dead = JobQueue(str(folder), ServerLease(folder / ".service"), Scripted(), 1, 8)
    job = dead.submit(order(folder), None)
    dead.state.release()
    with monkeypatch.context() as patch:
        refusing(patch, lambda record: True)
        assert opened().get(job["job"])["state"] == "queued"
    assert ended(opened(make_run), job)["state"] == "succeeded"


def test_the_journal_keeps_the_newest_ended_jobs(
    folder: Path, opened: Callable[..., JobQueue], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("ssil_service.jobs.registry.KEPT", 3)
    assert journal.KEPT == 1000
    board = opened(*[nothing] * 5)
    jobs = [board.submit(order(folder), f"key-{number}") for number in range(5)]
    for job in jobs[2:]:
        ended(board, job)
    files = {path.stem for path in (folder / ".service" / "jobs").iterdir()}
    assert files == {job["job"] for job in jobs[2:]}
    assert len(board.all()) == 3
    assert board.find_repeated("key-0", order(folder).request_digest) is None
    assert board.find_repeated("key-4", order(folder).request_digest) == board.get(jobs[4]["job"])


def test_a_job_of_a_server_that_left_nothing_else_is_taken_over(
    folder: Path, opened: Callable[..., JobQueue]
):
    dead = JobQueue(str(folder), ServerLease(folder / ".service"), Scripted(), 1, 8)
    job = dead.submit(order(folder), None)
    dead.state.close()
    board = opened(make_run)
    assert ended(board, job)["state"] == "succeeded"
