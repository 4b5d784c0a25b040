"""The job queue: jobs are accepted durably, run one after another, and found after a crash."""

from __future__ import annotations

import hashlib
import logging
import secrets
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from threading import Event, Thread
from typing import Any

from ssil_data.errors import ConflictError, SsilDataError
from ssil_service.jobs.journal import JobRecord, Journal
from ssil_service.jobs.registry import Job, JobRegistry, not_found, utc_now
from ssil_service.jobs.runner import Ending, Runner
from ssil_service.logs import log_event
from ssil_service.problems import Problem, busy
from ssil_service.workers.lease import ServerLease
from ssil_service.workers.pool import Pool

_STOPPED = Ending.of_error("ServerStoppedError", "the server stopped while the job ran")
_ENDED_BY_SHUTDOWN = ("CrashError", "ShutdownError")
"""Kinds of errors that mean, while the service shuts down, that it was the shutdown."""
_POLL_SECONDS = 0.05
_KILL_SECONDS = 5.0
"""Time for jobs to end whose workers were killed, and for the last look to end."""
_ADOPTION_SECONDS = 2.0
"""Time between two looks for jobs of servers that died."""


@dataclass(frozen=True, kw_only=True)
class JobRequest:
    """What a client wants made.

    Parameters
    ----------
    dataset, version
        What is to be scored.
    body
        What is to be made, see `ssil_service.workers.tasks.make_run`.
    run_name
        Name of the run; None lets the service choose one.
    name_prefix
        Beginning of the name that the service chooses.
    request_digest
        Digest of the request as it was sent.
    """

    dataset: str
    version: str
    body: Mapping[str, Any]
    run_name: str | None
    name_prefix: str
    request_digest: str


class JobQueue:
    """All jobs of this server, and a view of the other servers' of the same store.

    Parameters
    ----------
    store
        Folder or URI of the store.
    lease
        This server's; the journal lies beside it.
    pool
        Workers that fit and score.
    running
        Jobs that run at once.
    waiting
        Jobs that may wait.

    Raises
    ------
    OSError
        If the journal's folder cannot be written.
    """

    def __init__(
        self, store: str, lease: ServerLease, pool: Pool, *, running: int, waiting: int
    ) -> None:
        self.lease = lease
        self.pool = pool
        self.runner = Runner(store, pool)
        self.journal = Journal(lease.state_folder / "jobs")
        self._registry = JobRegistry(self.journal)
        self._running_limit = running
        self._waiting_limit = waiting
        self._closing = Event()
        self._adoption = Thread(target=self._keep_adopting, name="adoption", daemon=True)

    # start and end

    def start(self) -> None:
        """Adopt the jobs of dead servers, and start the threads that run jobs."""
        with self.lease.adopt_orphans() as living:
            for record in self.journal.all():
                if record.has_ended:
                    self._registry.restore(record)
            for record in self._find_orphans(living):
                with suppress(OSError):  # looked at again while the server runs
                    self._adopt(record)
        self._registry.trim()
        for number in range(self._running_limit):
            Thread(target=self._work, name=f"job-{number}", daemon=True).start()
        self._adoption.start()

    def _keep_adopting(self) -> None:
        """Look for jobs of servers that die while this one lives, until it closes.

        A server that was killed counts as alive until its last worker has ended, so the one that
        is started in its place may come too early. What the disk refuses is tried again at the
        next look.
        """
        has_failed = False
        while not self._closing.wait(_ADOPTION_SECONDS):
            try:
                self._registry.write_endings()
                with self.lease.adopt_orphans() as living:
                    self._adopt_late(living)
                has_failed = False
            except Exception:  # the folder cannot be read, say: told once, and looked again
                if not has_failed:
                    log_event("jobs not adopted", level=logging.ERROR, trace=True)
                has_failed = True

    def _adopt_late(self, living: set[str]) -> None:
        """Adopt what was running, and what waits while a thread is idle or younger jobs are here.

        At a busy server one orphan at a time waits behind the queue, and the others are left to
        servers that are idle.
        """
        for record in self._find_orphans(living):
            if self._closing.is_set():
                return
            if record.state == "running" or self._is_idle() or self._registry.has_turn(record):
                with suppress(OSError):  # what cannot be read now is looked at again
                    self._adopt(record)

    def _find_orphans(self, living: set[str]) -> list[JobRecord]:
        """Find the unfinished jobs that no living server has, the oldest first.

        An error of the disk may come after a record is written: the job then bears this server's
        id, though this server does not have it.
        """
        own = self._registry.find_unfinished()  # first, as a job may end while the journal is read
        others = living - {self.lease.server}
        return [
            record
            for record in self.journal.all()
            if not (record.has_ended or record.server in others or record.id in own)
        ]

    def _is_idle(self) -> bool:
        counts = self.counts()
        return counts["queued"] + counts["running"] < self._running_limit

    def _adopt(self, record: JobRecord) -> None:
        """Queue a job that a dead server left waiting; end one that it left running."""
        record = replace(record, server=self.lease.server)
        if record.state == "queued":
            with suppress(Problem):  # logged: the job is left to the next look, of any server
                self._registry.accept(record)
            return
        try:
            ending = self.runner.find_ending(record, _STOPPED)
        except OSError:
            raise
        except Exception as error:  # an invalid record must not stop the server from starting
            ending = _log_failure(record, error)
        self._registry.finish(self._registry.restore(record), ending)

    def close(self, grace: float) -> None:
        """End: running jobs have some time left, waiting ones are left to the next server.

        Parameters
        ----------
        grace
            Seconds until the workers of running jobs are killed.
        """
        self._closing.set()
        self._registry.close()
        self._wait_for_running(grace)
        self.pool.close()
        self._wait_for_running(_KILL_SECONDS)
        if self._adoption.is_alive():
            self._adoption.join(_KILL_SECONDS)
        self._registry.write_endings()

    def _wait_for_running(self, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while self.counts()["running"] and time.monotonic() < deadline:
            time.sleep(_POLL_SECONDS)

    # what clients do

    def submit(self, request: JobRequest, key: str | None) -> dict[str, Any]:
        """Accept a job, or return the one that was accepted under the same key.

        Parameters
        ----------
        request
            What is to be made.
        key
            The client's `Idempotency-Key`, None if it sent none.

        Returns
        -------
        dict
            The job as clients see it; it is in the journal.

        Raises
        ------
        Problem
            429 if the queue is full, 409 for a key that was used for another request, 503 if the
            journal cannot be written.
        ConflictError
            If the name is in use or reserved.
        NotFoundError
            If there is no such dataset.
        """
        with self.lease.exclusive():
            known = self.find_repeated(key, request.request_digest)
            if known is not None:
                return known
            self._refuse_if_full()
            record = JobRecord(
                id=secrets.token_hex(8) if key is None else _job_id(key),
                server=self.lease.server,
                dataset=request.dataset,
                version=request.version,
                body=request.body,
                run_name=self._choose_name(request),
                name_prefix=request.name_prefix if request.run_name is None else None,
                request_digest=request.request_digest,
                created=utc_now(),
            )
            try:
                self._registry.accept(record)
            except Problem:  # an error may come after it is written: it must not run all the same
                self.journal.forget(record.id)
                raise
        return record.to_json()

    def find_repeated(self, key: str | None, request_digest: str) -> dict[str, Any] | None:
        """Find the job that any server accepted under a key.

        Parameters
        ----------
        key
            The client's `Idempotency-Key`, None if it sent none.
        request_digest
            Digest of the request as it was sent.

        Returns
        -------
        dict or None
            The job as clients see it, None if there is none.

        Raises
        ------
        Problem
            409 for a key that was used for another request.
        """
        record = None if key is None else self._registry.find(_job_id(key))
        if record is None:
            return None
        if record.request_digest != request_digest:
            detail = "Idempotency-Key: already used for a different request; choose another key"
            raise Problem(409, detail)
        return self.get(record.id)

    def get(self, job_id: str) -> dict[str, Any]:
        """Return a job of any server.

        Parameters
        ----------
        job_id
            Any text.

        Returns
        -------
        dict
            The job as clients see it; only its own server knows its progress.

        Raises
        ------
        NotFoundError
            If there is no such job.
        """
        record = self._registry.find(job_id)
        if record is None:
            raise not_found(job_id)
        return record.to_json(self._registry.progress(job_id))

    def all(self) -> list[dict[str, Any]]:
        """Return all servers' jobs as clients see them, the newest first."""
        records = reversed(self._registry.records())
        return [record.to_json(self._registry.progress(record.id)) for record in records]

    def counts(self) -> dict[str, int]:
        """Count this server's jobs by state."""
        return self._registry.counts()

    def cancel(self, job_id: str) -> dict[str, Any]:
        """Cancel a queued job, or stop a running one; one that has ended stays as it is.

        Parameters
        ----------
        job_id
            Of a job of this server, or of a dead one.

        Returns
        -------
        dict
            The job as clients see it; a running job is shown as `cancelled` once its worker ended.

        Raises
        ------
        NotFoundError
            If there is no such job.
        ConflictError
            If another server runs it.
        Problem
            503 if the journal cannot be written.
        """
        record = self._registry.find(job_id)
        own = self._registry.find_unfinished()
        if record is None or record.has_ended or job_id in own:
            self._registry.cancel(job_id)
        else:
            self._cancel_elsewhere(job_id)
        return self.get(job_id)

    def _cancel_elsewhere(self, job_id: str) -> None:
        """Cancel the job of a dead server, which no other can; refuse that of a living one."""
        with self.lease.adopt_orphans() as living:
            orphan = next((each for each in self._find_orphans(living) if each.id == job_id), None)
            if orphan is not None and orphan.state == "running":
                with suppress(OSError):  # what cannot be read now is looked at again
                    self._adopt(orphan)
                orphan = None
            if orphan is not None:
                orphan = replace(orphan, server=self.lease.server)
            self._registry.cancel(job_id, orphan)

    def _refuse_if_full(self) -> None:
        """Raise a Problem with 429 if no more jobs may wait, or the service ends."""
        counts = self.counts()
        unfinished = counts["queued"] + counts["running"]
        if unfinished >= self._waiting_limit + self._running_limit or self._registry.closed:
            detail = f"jobs: the queue is full ({unfinished} jobs); retry after 5 s"
            raise busy(429, detail, 5)

    def _choose_name(self, request: JobRequest) -> str:
        """Return the name that the job's run will have; no other job's will."""
        reserved = self._registry.find_reserved_names(request.dataset)
        wanted = request.run_name or request.name_prefix
        name = self.runner.find_free_name(request.dataset, wanted, reserved)
        if request.run_name not in (None, name):
            raise ConflictError(
                f"run of {request.dataset}: the name {request.run_name} is in use or reserved "
                "by a job; choose another"
            )
        return name

    # what the threads do

    def _work(self) -> None:
        """Run jobs until the service ends; whatever a job raises, the thread goes on."""
        while (job := self._registry.take_next()) is not None:
            try:
                ending = self._run(job)
            except (SsilDataError, Problem) as error:
                ending = self.runner.explain(error)
            except Exception as error:
                ending = _log_failure(job.record, error)
            ended_early = ending.error is not None and ending.error["kind"] in _ENDED_BY_SHUTDOWN
            if self._registry.closed and ended_early:
                ending = _STOPPED
            self._registry.finish(job, ending)

    def _run(self, job: Job) -> Ending:
        """Make a job's run, under another name if its own is taken meanwhile."""
        while True:
            self._write_start(job)
            ending = self.runner.run(
                job.record,
                report=partial(self._registry.report, job),
                assign_worker=partial(self._registry.assign_worker, job),
            )
            if not self._needs_another_name(job, ending):
                return ending

    def _write_start(self, job: Job) -> None:
        """Write to the journal that a job runs; if its name is in use by now, under another."""
        with self.lease.exclusive():
            record = job.record
            name = record.run_name
            if record.name_prefix is not None and self.runner.name_is_used(record):
                reserved = self._registry.find_reserved_names(record.dataset)
                name = self.runner.find_free_name(record.dataset, record.name_prefix, reserved)
            self._registry.write_start(job, name)

    def _needs_another_name(self, job: Job, ending: Ending) -> bool:
        """Return whether the name that the service chose was taken while the job ran.

        Only a writer outside the service can take it, as jobs reserve their names. A name that the
        client chose is never changed.
        """
        record = job.record
        conflict = ending.error is not None and ending.error["kind"] == ConflictError.__name__
        stopped = job.cancel_requested or self._registry.closed
        return (
            conflict
            and not stopped
            and record.name_prefix is not None
            and self.runner.name_is_used(record)
        )


def _log_failure(record: JobRecord, error: Exception) -> Ending:
    """Log an error while it is handled, and return the ending of its job."""
    log_event("job failed", level=logging.ERROR, trace=True, job=record.id)
    return Ending.of_error("InternalError", f"the service failed ({type(error).__name__})")


def _job_id(key: str) -> str:
    """Return the id of the job that is accepted under a key, the same at all servers."""
    return hashlib.sha256(key.encode()).hexdigest()[:16]
