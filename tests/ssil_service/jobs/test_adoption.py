"""The jobs of dead servers: one that lives looks for them again and again, and has each once."""

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import ssil_data as sd
from ssil_service.jobs.journal import JobRecord, Journal
from ssil_service.jobs.queue import JobQueue, JobRequest
from ssil_service.jobs.registry import utc_now
from ssil_service.jobs.runner import Ending, Runner
from ssil_service.problems import Problem
from ssil_service.workers.lease import ServerLease

Work = Callable[..., Any]
QUEUE = "ssil_service.jobs.queue"
DEAD = "0" * 16
"""Id of a server that has no folder any more."""


class Scripted:
    """A pool whose tasks are functions, one after another; it notes the names of their runs."""

    def __init__(self, *works: Work) -> None:
        self.works = list(works)
        self.runs: list[str] = []

    def run(self, task: str, arguments: dict[str, Any], **callbacks: Any) -> None:
        self.runs.append(arguments["run"])
        self.works.pop(0)()

    def close(self) -> None:
        pass


def nothing() -> None:
    pass


@pytest.fixture
def journal(folder: Path) -> Journal:
    """The journal, as another server of the store reads it."""
    return Journal(folder / ".service" / "jobs")


@pytest.fixture
def start(folder: Path) -> Iterator[Callable[..., JobQueue]]:
    """Start job queues on one store, each of a server of its own."""
    queues: list[JobQueue] = []

    def start(*works: Work) -> JobQueue:
        pool: Any = Scripted(*works)
        lease = ServerLease(folder / ".service")
        queues.append(JobQueue(str(folder), lease, pool, running=1, waiting=8))
        queues[-1].start()
        return queues[-1]

    yield start
    for each in queues:
        each.close(5)
        each.lease.close()


@dataclass
class Looks:
    """How many looks for orphans have begun and ended."""

    begun: int = 0
    ended: int = 0

    def wait_for(self, number: int) -> None:
        """Wait until so many more have begun and ended."""
        last = self.begun + number
        wait_until(lambda: self.ended >= last)

    def wait_for_begun(self) -> None:
        """Wait until one has begun that has not ended."""
        wait_until(lambda: self.begun > self.ended)


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> Looks:
    """A server looks twenty times a second, and its looks are counted."""
    looks = Looks()
    adopt_orphans = ServerLease.adopt_orphans

    @contextmanager
    def counted(self: ServerLease) -> Iterator[set[str]]:
        looks.begun += 1
        with adopt_orphans(self) as living:
            yield living
        looks.ended += 1

    monkeypatch.setattr(ServerLease, "adopt_orphans", counted)
    monkeypatch.setattr(f"{QUEUE}._ADOPTION_SECONDS", 0.05)
    return looks


def write_orphan(folder: Path, journal: Journal, state: Any = "queued", number: int = 1) -> str:
    """Write the record of a job that a dead server left, and return the job's id."""
    record = JobRecord(
        id=f"{number:016x}",
        server=DEAD,
        dataset="drives",
        version=sd.Store(folder)["drives"].version,
        body={},
        run_name=f"left-{number}",
        name_prefix=None,
        request_digest="",
        created=utc_now(),
        state=state,
    )
    journal.write(record)
    return record.id


def submit(folder: Path, queue: JobQueue, run: str) -> str:
    request = JobRequest(
        dataset="drives",
        version=sd.Store(folder)["drives"].version,
        body={},
        run_name=run,
        name_prefix=run,
        request_digest="",
    )
    return queue.submit(request, None)["job"]


def find(journal: Journal, job: str) -> JobRecord:
    record = journal.get(job)
    assert record is not None
    return record


def wait_until(found: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not found():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@contextmanager
def refused_writes(
    monkeypatch: pytest.MonkeyPatch, *, half_done: bool = False
) -> Iterator[list[str]]:
    """Let the disk refuse what living servers write; yield the ids of the jobs that it refused.

    What is half done is in its file, and the error came after.
    """
    refused: list[str] = []
    write = Journal.write

    def refuse(self: Journal, record: JobRecord) -> None:
        if half_done or record.server == DEAD:
            write(self, record)
        if record.server != DEAD:
            refused.append(record.id)
            raise OSError(28, "no space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Journal, "write", refuse)
        yield refused


def logged(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [each.getMessage() for each in caplog.records if each.levelno >= logging.ERROR]


# what is found


@pytest.mark.parametrize(("state", "end"), [("queued", "succeeded"), ("running", "failed")])
def test_the_job_of_a_server_that_starts_and_dies_between_two_looks_is_adopted(
    state: str,
    end: str,
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
    looks: Looks,
):
    queue = start(nothing)
    looks.wait_for(2)
    job = write_orphan(folder, journal, state)
    wait_until(lambda: queue.get(job)["state"] == end)
    wait_until(lambda: find(journal, job).state == end)
    assert find(journal, job).server == queue.lease.server


def test_jobs_are_adopted_once_in_their_order_and_the_running_one_is_left_alone(
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
    looks: Looks,
):
    go_on = threading.Event()

    def wait() -> None:
        assert go_on.wait(20)

    jobs = [write_orphan(folder, journal, number=number) for number in (3, 1)]
    queue = start(wait, nothing, nothing, nothing)
    jobs.append(submit(folder, queue, "own"))
    jobs.append(write_orphan(folder, journal, number=2))  # left until a thread is idle
    wait_until(lambda: find(journal, jobs[0]).state == "running")
    looks.wait_for(3)
    assert [queue.get(job)["state"] for job in jobs] == ["running", *["queued"] * 3]
    assert [find(journal, job).server == DEAD for job in jobs] == [False, False, False, True]
    go_on.set()
    wait_until(lambda: all(queue.get(job)["state"] == "succeeded" for job in jobs))
    looks.wait_for(2)
    assert queue.pool.runs == ["left-3", "left-1", "own", "left-2"]  # pyright: ignore
    assert [find(journal, job).state for job in jobs] == ["succeeded"] * 4


def test_a_job_that_ends_while_the_journal_is_read_has_its_own_ending(
    folder: Path, start: Callable[..., JobQueue], monkeypatch: pytest.MonkeyPatch
):
    go_on = threading.Event()

    def wait() -> None:
        assert go_on.wait(20)

    queue = start(wait)
    job = submit(folder, queue, "own")
    wait_until(lambda: find(queue.journal, job).state == "running")
    read = Journal.all

    def read_and_end(self: Journal) -> list[JobRecord]:
        records = read(self)
        go_on.set()
        wait_until(lambda: queue.counts()["running"] == 0)
        return records

    monkeypatch.setattr(Journal, "all", read_and_end)
    with queue.lease.adopt_orphans() as living:
        queue._adopt_late(living)
    assert queue.get(job)["state"] == "succeeded"


# what the disk refuses


@pytest.mark.parametrize("half_done", [False, True])
@pytest.mark.parametrize("when", ["start", "look"])
def test_a_waiting_job_whose_adoption_is_refused_is_adopted_at_a_later_look_and_told_once(
    when: str,
    half_done: bool,
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
    looks: Looks,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
):
    with refused_writes(monkeypatch, half_done=half_done) as refused:
        if when == "start":
            job = write_orphan(folder, journal)
            queue = start(nothing)
        else:
            queue = start(nothing)
            job = write_orphan(folder, journal)
        wait_until(lambda: len(refused) >= 3)
    wait_until(lambda: queue.get(job)["state"] == "succeeded")
    assert find(journal, job).server == queue.lease.server
    assert queue.pool.runs == ["left-1"]  # pyright: ignore
    assert (set(refused), logged(caplog)) == ({job}, ["journal not written"])


@pytest.mark.parametrize("half_done", [False, True])
@pytest.mark.parametrize("whose", ["own", "left"])
def test_an_ending_that_is_refused_is_written_at_a_later_look_and_told_once(
    whose: str,
    half_done: bool,
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
    looks: Looks,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
):
    go_on = threading.Event()

    def wait() -> None:
        assert go_on.wait(20)

    queue = start(wait)
    own = submit(folder, queue, "own") if whose == "own" else None
    wait_until(lambda: own is None or find(journal, own).state == "running")
    with refused_writes(monkeypatch, half_done=half_done) as refused:
        go_on.set()
        job = own or write_orphan(folder, journal, "running")
        wait_until(lambda: len(refused) >= 1)
        wait_until(lambda: queue.counts()["running"] == 0)
        ended = queue.get(job)
        wait_until(lambda: len(refused) >= 4)
        assert queue.get(job) == ended
    wait_until(lambda: find(Journal(folder / ".service" / "jobs"), job).has_ended)
    looks.wait_for(1)
    assert find(journal, job).to_json() == queue.get(job) == ended
    assert logged(caplog) == ["journal not written"]


def test_a_refusal_is_told_again_once_the_disk_has_taken_a_record(
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
    looks: Looks,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
):
    go_on = threading.Event()

    def wait() -> None:
        assert go_on.wait(20)

    queue = start(wait)
    with refused_writes(monkeypatch) as refused:
        job = write_orphan(folder, journal)
        wait_until(lambda: len(refused) >= 2)
    wait_until(lambda: queue.pool.runs == ["left-1"])  # pyright: ignore
    with refused_writes(monkeypatch) as refused:
        go_on.set()
        wait_until(lambda: len(refused) >= 2)
    wait_until(lambda: find(journal, job).has_ended)
    assert logged(caplog) == ["journal not written"] * 2


def test_a_submission_that_is_refused_after_it_was_written_does_not_run(
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
    looks: Looks,
    monkeypatch: pytest.MonkeyPatch,
):
    queue = start(nothing)
    with (
        refused_writes(monkeypatch, half_done=True),
        pytest.raises(Problem, match="retry after 30 s"),
    ):
        submit(folder, queue, "own")
    looks.wait_for(2)
    assert (journal.all(), queue.all()) == ([], [])
    submit(folder, queue, "own")  # its name is free
    wait_until(lambda: queue.counts()["succeeded"] == 1)
    assert queue.pool.runs == ["own"]  # pyright: ignore


def test_a_cancel_that_is_refused_after_it_was_written_counts_at_all_servers(
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
    looks: Looks,
    monkeypatch: pytest.MonkeyPatch,
):
    end = threading.Event()
    queue = start(lambda: end.wait(20), nothing)
    submit(folder, queue, "running")
    wait_until(lambda: queue.counts()["running"] == 1)
    job = submit(folder, queue, "waiting")
    with refused_writes(monkeypatch, half_done=True), pytest.raises(Problem):
        queue.cancel(job)
    assert find(journal, job).state == queue.get(job)["state"] == "cancelled"
    (journal_folder(folder) / f"{job}.json").unlink()  # as if it were not on the disk after all
    looks.wait_for(2)
    end.set()
    wait_until(lambda: queue.counts()["succeeded"] == 1)
    looks.wait_for(1)
    assert find(Journal(journal_folder(folder)), job).state == "cancelled"
    assert queue.pool.runs == ["running"]  # pyright: ignore


# the turn of those that wait


def test_an_orphan_at_a_busy_server_runs_though_new_jobs_keep_coming(
    folder: Path, journal: Journal, start: Callable[..., JobQueue], looks: Looks
):
    queue = start(*[lambda: time.sleep(0.1)] * 200)
    orphans = [write_orphan(folder, journal, number=number) for number in (1, 2)]
    sent = 0
    deadline = time.monotonic() + 20
    while not all(find(journal, orphan).has_ended for orphan in orphans):
        assert time.monotonic() < deadline
        if queue.counts()["queued"] < 2:
            submit(folder, queue, f"own-{sent}")
            sent += 1
        time.sleep(0.01)


def test_orphans_at_a_busy_server_wait_one_at_a_time(
    folder: Path, journal: Journal, start: Callable[..., JobQueue], looks: Looks
):
    end = threading.Event()
    queue = start(lambda: end.wait(20), *[nothing] * 4)
    with queue.lease.exclusive():  # between two looks
        orphans = [write_orphan(folder, journal, number=number) for number in (1, 2, 3)]
    wait_until(lambda: queue.counts()["running"] == 1)
    looks.wait_for(3)
    assert [find(journal, orphan).server == DEAD for orphan in orphans] == [False, True, True]
    end.set()
    wait_until(lambda: all(find(journal, orphan).has_ended for orphan in orphans))
    assert queue.pool.runs == ["left-1", "left-2", "left-3"]  # pyright: ignore


def test_an_orphan_that_is_younger_than_what_runs_is_left_to_a_server_that_is_idle(
    folder: Path, journal: Journal, start: Callable[..., JobQueue], looks: Looks
):
    end = threading.Event()
    busy = start(lambda: end.wait(20))
    submit(folder, busy, "own")
    wait_until(lambda: busy.counts()["running"] == 1)
    job = write_orphan(folder, journal)
    looks.wait_for(3)
    assert find(journal, job).server == DEAD
    idle = start(nothing)
    wait_until(lambda: find(journal, job).state == "succeeded")
    end.set()
    assert idle.pool.runs == ["left-1"]  # pyright: ignore


@pytest.mark.parametrize(("state", "end"), [("queued", "cancelled"), ("running", "failed")])
def test_the_job_of_a_dead_server_is_canceled_at_a_busy_one(
    state: str,
    end: str,
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
):
    go_on = threading.Event()
    queue = start(lambda: go_on.wait(20))
    submit(folder, queue, "own")
    wait_until(lambda: queue.counts()["running"] == 1)
    job = write_orphan(folder, journal, state)  # no look comes before it is canceled
    assert queue.cancel(job)["state"] == end
    assert find(journal, job).state == end
    go_on.set()
    wait_until(lambda: queue.counts()["succeeded"] == 1)
    assert queue.pool.runs == ["own"]  # pyright: ignore


@pytest.mark.parametrize("half_done", [False, True])
def test_a_cancel_of_a_dead_server_s_job_that_is_refused_can_be_sent_again(
    half_done: bool,
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
    monkeypatch: pytest.MonkeyPatch,
):
    queue = start()
    job = write_orphan(folder, journal)
    with (
        refused_writes(monkeypatch, half_done=half_done),
        pytest.raises(Problem, match="retry after 30 s"),
    ):
        queue.cancel(job)
    assert queue.get(job)["state"] == ("cancelled" if half_done else "queued")
    assert queue.cancel(job)["state"] == find(journal, job).state == "cancelled"


def test_a_job_of_a_living_server_is_canceled_there_only(
    folder: Path, start: Callable[..., JobQueue]
):
    end = threading.Event()
    one, other = start(lambda: end.wait(20), nothing), start()
    jobs = [submit(folder, one, name) for name in ("running", "waiting")]
    wait_until(lambda: one.counts()["running"] == 1)
    for job in jobs:
        with pytest.raises(sd.ConflictError, match="belongs to another server; cancel it there"):
            other.cancel(job)
    end.set()
    wait_until(lambda: one.counts()["succeeded"] == 2)


# the end


def close_in_thread(queue: JobQueue) -> threading.Thread:
    """Close a queue in a thread, and return it once the closing has begun."""
    thread = threading.Thread(target=queue.close, args=(0,))
    thread.start()
    assert queue._closing.wait(20)
    return thread


def test_a_server_that_closes_adopts_nothing_and_waits_for_its_last_look(
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
    looks: Looks,
):
    queue = start()
    with queue.lease.exclusive():
        jobs = [write_orphan(folder, journal, "queued", 1)]
        jobs.append(write_orphan(folder, journal, "running", 2))
        looks.wait_for_begun()
        closing = close_in_thread(queue)
        closing.join(0.3)
        assert closing.is_alive()
    closing.join(20)
    assert not queue._adoption.is_alive()
    assert [find(journal, job).server for job in jobs] == [DEAD, DEAD]


def test_a_server_that_begins_to_close_while_it_adopts_leaves_the_rest(
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
    looks: Looks,
    monkeypatch: pytest.MonkeyPatch,
):
    queue = start()
    finished: list[str] = []
    finding = type(queue.runner).find_ending

    def find_and_close(self: Any, record: JobRecord, failure: Any) -> Any:
        finished.append(record.id)
        queue._closing.set()
        return finding(self, record, failure)

    monkeypatch.setattr(type(queue.runner), "find_ending", find_and_close)
    with queue.lease.exclusive():
        jobs = [write_orphan(folder, journal, "running", number) for number in (1, 2)]
    assert queue._closing.wait(20)
    queue.close(0)
    assert finished == jobs[:1]
    assert find(journal, jobs[1]).server == DEAD


def test_a_look_that_does_not_end_holds_up_the_closing_for_some_seconds_only(
    folder: Path,
    start: Callable[..., JobQueue],
    looks: Looks,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(f"{QUEUE}._KILL_SECONDS", 0.2)
    queue = start()
    with queue.lease.exclusive():
        looks.wait_for_begun()
        closing = close_in_thread(queue)
        closing.join(20)
        assert not closing.is_alive()


def test_a_queue_that_was_never_started_closes(folder: Path):
    pool: Any = Scripted()
    queue = JobQueue(str(folder), ServerLease(folder / ".service"), pool, running=1, waiting=8)
    queue.close(0)
    queue.lease.close()


def test_a_record_that_cannot_be_written_does_not_stop_the_endings_of_others(
    folder: Path, journal: Journal, start: Callable[..., JobQueue], looks: Looks
):
    end = threading.Event()
    queue = start(lambda: end.wait(20), nothing)
    refused = submit(folder, queue, "refused")
    wait_until(lambda: find(journal, refused).state == "running")
    path = folder / ".service" / "jobs" / f"{refused}.json"
    path.unlink()
    path.mkdir()
    end.set()
    other = submit(folder, queue, "other")
    wait_until(lambda: queue.get(other)["state"] == "succeeded")
    looks.wait_for(2)
    assert find(Journal(journal_folder(folder)), other).state == "succeeded"


def test_an_ending_that_the_disk_refused_is_written_when_the_server_closes(
    folder: Path, journal: Journal, start: Callable[..., JobQueue], monkeypatch: pytest.MonkeyPatch
):
    end = threading.Event()

    def fail() -> None:
        end.wait(20)
        raise sd.errors.DamagedError("file: is damaged")

    queue = start(fail)
    job = submit(folder, queue, "job")
    wait_until(lambda: find(journal, job).state == "running")
    with refused_writes(monkeypatch):
        end.set()
        wait_until(lambda: queue.counts()["running"] == 0)
    queue.close(1)
    ended = find(Journal(journal_folder(folder)), job)
    assert ended.error == queue.get(job)["error"]


def test_a_job_that_is_forgotten_is_not_written_again(
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
    looks: Looks,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr("ssil_service.jobs.registry.KEPT", 1)
    queue = start()
    with refused_writes(monkeypatch):
        for number in range(4):
            write_orphan(folder, journal, "running", number + 1)
        wait_until(lambda: sum(queue.counts().values()) == 1)
        looks.wait_for(2)
    looks.wait_for(2)
    assert len(list(journal_folder(folder).glob("*.json"))) == 1


@pytest.mark.parametrize("starts_first", [True, False])
def test_a_job_whose_store_cannot_be_read_is_looked_at_again(
    folder: Path,
    journal: Journal,
    start: Callable[..., JobQueue],
    looks: Looks,
    monkeypatch: pytest.MonkeyPatch,
    starts_first: bool,
):
    asked: list[str] = []

    def find_ending(self: Runner, record: JobRecord, failure: Ending) -> Ending:
        asked.append(record.id)
        if len(asked) == 1:
            raise OSError(5, "Input/output error")
        return Ending("succeeded")

    monkeypatch.setattr(Runner, "find_ending", find_ending)
    if starts_first:
        queue = start()
        job = write_orphan(folder, journal, "running")
    else:
        job = write_orphan(folder, journal, "running")
        queue = start()
    wait_until(lambda: len(asked) == 2)
    looks.wait_for(1)
    assert queue.get(job)["state"] == "succeeded"


def journal_folder(folder: Path) -> Path:
    return folder / ".service" / "jobs"
