"""Scoring jobs: accepted durably, run one after another, found again after a crash."""

from __future__ import annotations

import hashlib
import logging
import secrets
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from threading import Thread
from typing import Any

from ssil_data.errors import ConflictError, NotFoundError, SsilDataError
from ssil_service.jobs.journal import ENDED, JobRecord
from ssil_service.jobs.registry import Job, JobRegistry, now
from ssil_service.jobs.runner import Ending, Runner, fault
from ssil_service.logs import log_event
from ssil_service.problems import Problem, busy
from ssil_service.workers.lease import ServerLease
from ssil_service.workers.pool import Pool, Worker

_STOPPED = fault("ServerStoppedError", "the server stopped while the job ran")
_CUT_OFF = ("CrashError", "ShutdownError")


@dataclass(frozen=True)
class JobRequest:
    """What a client wants made: the body of the job, and the name of its run or its beginning."""

    dataset: str
    version: str
    body: Mapping[str, Any]
    run: str | None
    name_prefix: str
    request_digest: str
    """A digest of the request as it was sent."""


class JobQueue:
    """All jobs of this server, and a view of the others' of the same store."""

    def __init__(
        self, store: str, state: ServerLease, pool: Pool, running: int, queue: int
    ) -> None:
        """Begin without a job; `running` at once, and `queue` that wait."""
        self.state, self.pool = state, pool
        self.running, self.queue = running, queue
        self.runner = Runner(store, pool)
        self.ledger = JobRegistry(state.journal)
        self.counts = self.ledger.counts
        self._closing = False

    def start(self) -> None:
        """Take over what dead servers left, and begin to run jobs."""
        with self.state.adopt_orphans() as living:
            for record in self.state.journal.all():
                if record.over:
                    self.ledger.entries[record.job] = Job(record)
                elif record.server not in living:
                    self._adopt(replace(record, server=self.state.server))
        self.ledger.trim()
        for number in range(self.running):
            Thread(target=self._work, name=f"job-{number}", daemon=True).start()

    def _adopt(self, record: JobRecord) -> None:
        entry = Job(record)
        if record.state == "queued":
            with suppress(Problem):  # told: it is left to the next server
                self.ledger.keep(record)
                self.ledger.entries[record.job] = entry
            return
        try:
            ending = self.runner.find_ending(record, _STOPPED)
        except Exception as error:  # a record that no server wrote, say: it stops no start
            ending = _log_failure(record, error)
        self.ledger.entries[record.job] = entry
        self.ledger.end(entry, ending)

    def find_repeated(self, key: str | None, asked: str) -> dict[str, Any] | None:
        """Return the job that was accepted under a key, by whichever server, if there is one.

        Raises a Problem with 409 for a key used for another request.
        """
        record = None if key is None else self.ledger.find(_job_id(key))
        if record is None:
            return None
        if record.asked != asked:
            raise Problem(409, "Idempotency-Key: expected another, found it used before")
        return self.get(record.job)

    def submit(self, order: JobRequest, key: str | None) -> dict[str, Any]:
        """Accept a job, or return the one that was accepted under the same key.

        Raises a Problem: 429 when the queue is full, 409 for a key used for another request, 503
        if the journal cannot be written; ConflictError for a name in use, NotFoundError.
        """
        with self.state.exclusive():
            known = self.find_repeated(key, order.request_digest)
            if known is not None:
                return known
            counts = self.counts()
            unfinished = counts["queued"] + counts["running"]
            if unfinished >= self.queue + self.running or self._closing:
                raise busy(429, "jobs: expected a free place, found the queue full", 5)
            record = JobRecord(
                job=secrets.token_hex(8) if key is None else _job_id(key),
                server=self.state.server,
                dataset=order.dataset,
                version=order.version,
                body=order.body,
                run=self._name(order),
                stem=order.name_prefix if order.run is None else None,
                asked=order.request_digest,
                created=now(),
            )
            self.ledger.keep(record)
            with self.ledger.changed:
                self.ledger.entries[record.job] = Job(record)
                self.ledger.changed.notify()
        return record.as_shown()

    def _name(self, order: JobRequest) -> str:
        """Return the name that the job's run will have; no other job's will."""
        reserved = self.ledger.reserved_names(order.dataset)
        name = self.runner.free_name(order.dataset, order.run or order.name_prefix, reserved)
        if order.run not in (None, name):
            raise ConflictError(
                f"run of {order.dataset}: expected an unused name, found one in use or reserved"
            )
        return name

    def get(self, job: str) -> dict[str, Any]:
        """Return a job as clients see it; raises NotFoundError."""
        entry, record = self.ledger.entries.get(job), self.ledger.find(job)
        if record is None:
            raise NotFoundError("job: expected one of the service's, found another")
        return record.as_shown(entry.progress if entry else None)

    def all(self) -> list[dict[str, Any]]:
        """Return all jobs of the store's servers, the newest first."""
        entries = self.ledger.copy()
        progress = {job: entry.progress for job, entry in entries.items()}
        return [each.as_shown(progress.get(each.job)) for each in reversed(self.ledger.records())]

    def cancel(self, job: str) -> dict[str, Any]:
        """Stop a job; one that has ended stays as it is.

        Raises NotFoundError, or ConflictError for a job of another server.
        """
        with self.ledger.changed:
            shown, entry = self.get(job), self.ledger.entries.get(job)
            if shown["state"] in ENDED:
                return shown
            if entry is None:
                raise ConflictError(f"job {job}: expected one of this server, found another's")
            if entry.record.state == "queued":
                record = replace(entry.record, state="cancelled", ended=now())
                self.ledger.keep(record)
                entry.record = record
            else:
                entry.cancelled = True
                if entry.worker is not None:
                    entry.worker.kill_soon()
        return self.get(job)

    def close(self, grace: float) -> None:
        """Let running jobs end for `grace` seconds; queued ones are left to the next server."""
        with self.ledger.changed:
            self._closing = True
            self.ledger.changed.notify_all()
        self._wait(grace)
        self.pool.close()
        self._wait(5)

    def _wait(self, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while self.counts()["running"] and time.monotonic() < deadline:
            time.sleep(0.05)

    def _work(self) -> None:
        """Run jobs until the service ends; nothing that a job meets ends the thread."""
        while (entry := self._next()) is not None:
            try:
                ending = self._run(entry)
            except (SsilDataError, Problem) as error:
                ending = self.runner.refuse(error)
            except Exception as error:
                ending = _log_failure(entry.record, error)
            if self._closing and ending.error and ending.error["kind"] in _CUT_OFF:
                ending = _STOPPED
            self.ledger.end(entry, ending)

    def _next(self) -> Job | None:
        """Wait for a job and take it; nothing when the service ends."""
        with self.ledger.changed:
            while not self._closing:
                for entry in self.ledger.entries.values():
                    if entry.record.state == "queued":
                        entry.record = replace(entry.record, state="running", started=now())
                        return entry
                self.ledger.changed.wait()
        return None

    def _run(self, entry: Job) -> Ending:
        def started(worker: Worker | None) -> None:
            with self.ledger.changed:  # under which it is cancelled: never somebody else's worker
                entry.worker = worker
                if worker is not None and entry.cancelled:
                    worker.kill_soon()

        def report(progress: dict[str, Any]) -> None:
            entry.progress = progress

        while True:
            self._begin(entry)
            ending = self.runner.run(entry.record, report=report, started=started)
            if not self._claimed_elsewhere(entry, ending):
                return ending

    def _begin(self, entry: Job) -> None:
        """Journal that a job runs, under another name if somebody outside took the one it had."""
        with self.state.exclusive():
            record = entry.record
            if record.stem is not None and self.runner.name_is_used(record):
                reserved = self.ledger.reserved_names(record.dataset)
                name = self.runner.free_name(record.dataset, record.stem, reserved)
                entry.record = replace(record, run=name)
            self.state.journal.write(entry.record)

    def _claimed_elsewhere(self, entry: Job, ending: Ending) -> bool:
        """Tell whether somebody outside took, meanwhile, a name that the client did not choose."""
        record, error = entry.record, ending.error
        conflict = error is not None and error["kind"] == ConflictError.__name__
        given_up = entry.cancelled or self._closing
        return (
            conflict
            and not given_up
            and record.stem is not None
            and self.runner.name_is_used(record)
        )


def _log_failure(record: JobRecord, error: Exception) -> Ending:
    """Log an error while it is handled, and return the ending of its job."""
    log_event("job failed", level=logging.ERROR, trace=True, job=record.job)
    return fault("InternalError", f"the service failed ({type(error).__name__})")


def _job_id(key: str) -> str:
    """Return the number of the job that is accepted under a key, the same for all servers."""
    return hashlib.sha256(key.encode()).hexdigest()[:16]
