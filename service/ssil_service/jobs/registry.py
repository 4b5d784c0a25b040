"""The jobs that a server knows: its own as they are now, the others' as the journal has them."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from threading import Condition
from typing import Any

from ssil_data.errors import ConflictError, NotFoundError
from ssil_service.jobs.journal import ENDED, KEPT, JobRecord, JobState, Journal
from ssil_service.jobs.runner import Ending
from ssil_service.logs import log_event
from ssil_service.problems import Problem, busy
from ssil_service.workers.worker import Worker


@dataclass
class Job:
    """A job of this server: its record, its progress, and the process that it runs in."""

    record: JobRecord
    progress: dict[str, Any] | None = None
    worker: Worker | None = None
    cancel_requested: bool = False


class JobRegistry:
    """This server's jobs by id, and a view of the other servers'.

    The registry owns the lock under which its jobs change: they are changed by its methods only,
    from any thread. A thread may hold `ServerLease.exclusive` when it calls them, but must not
    take that lock inside them.

    Parameters
    ----------
    journal
        Where all servers' jobs are written.
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._jobs: dict[str, Job] = {}
        self._changed = Condition()
        self._closed = False
        self._unwritten: dict[str, JobRecord] = {}
        self._refused: set[str] = set()

    # what is known

    @property
    def closed(self) -> bool:
        """Whether the server ends: no job is taken any more."""
        return self._closed

    def find(self, job_id: str) -> JobRecord | None:
        """Return a job's record, whichever server's it is.

        Parameters
        ----------
        job_id
            Any text.

        Returns
        -------
        JobRecord or None
            None if there is no such job.
        """
        job = self._jobs.get(job_id)
        return self._journal.get(job_id) if job is None else job.record

    def progress(self, job_id: str) -> dict[str, Any] | None:
        """Return how far a job is.

        Parameters
        ----------
        job_id
            Any text.

        Returns
        -------
        dict or None
            What it does, and `done` of how many steps; None before it runs, and for another
            server's job.
        """
        job = self._jobs.get(job_id)
        return None if job is None else job.progress

    def records(self) -> list[JobRecord]:
        """Return all servers' records, the oldest first."""
        records = {record.id: record for record in self._journal.all()}
        records |= {record.id: record for record in self._own_records()}
        return sorted(records.values(), key=lambda record: record.created)

    def find_reserved_names(self, dataset: str) -> set[str]:
        """Return the names that are reserved for the runs of unfinished jobs.

        Parameters
        ----------
        dataset
            Whose runs they are.

        Returns
        -------
        set of str
            Of all servers' jobs.
        """
        return {
            record.run_name
            for record in self.records()
            if record.dataset == dataset and not record.has_ended
        }

    def find_unfinished(self) -> set[str]:
        """Return the ids of this server's jobs that the journal may have as unfinished."""
        with self._changed:
            unfinished = {job_id for job_id, job in self._jobs.items() if not job.record.has_ended}
            return unfinished | self._unwritten.keys()

    def has_turn(self, record: JobRecord) -> bool:
        """Tell whether a job that waits elsewhere has waited longer than what this server has.

        Parameters
        ----------
        record
            Of the job.

        Returns
        -------
        bool
            Whether it is older than all jobs that wait here; where none does, than one that runs.
        """
        own = self._own_records()
        waiting = [each.created for each in own if each.state == "queued"]
        running = [each.created for each in own if each.state == "running"]
        return record.created < (min(waiting) if waiting else max(running, default=""))

    def counts(self) -> dict[str, int]:
        """Count this server's jobs by state."""
        states = [record.state for record in self._own_records()]
        return {state: states.count(state) for state in ("queued", "running", *ENDED)}

    def _own_records(self) -> list[JobRecord]:
        with self._changed:
            return [job.record for job in self._jobs.values()]

    # how a job comes in

    def restore(self, record: JobRecord) -> Job:
        """Add a job that the journal has already.

        Parameters
        ----------
        record
            It is not written again.

        Returns
        -------
        Job
            The job, to be finished if it did not end.
        """
        job = Job(record)
        with self._changed:
            self._jobs[record.id] = job
        return job

    def accept(self, record: JobRecord) -> None:
        """Write a queued job to the journal, then let a thread take it.

        Parameters
        ----------
        record
            Of a new job, or of one that is adopted.

        Raises
        ------
        Problem
            503 if the journal cannot be written; the job is not accepted then.
        """
        self._write_or_refuse(record)
        with self._changed:
            self._jobs[record.id] = Job(record)
            self._changed.notify()

    # how it runs

    def take_next(self) -> Job | None:
        """Wait for a queued job and mark it as running; None when the server ends."""
        with self._changed:
            while not self._closed:
                for job in self._jobs.values():
                    if job.record.state == "queued":
                        job.record = replace(job.record, state="running", started=utc_now())
                        return job
                self._changed.wait()
        return None

    def write_start(self, job: Job, run_name: str) -> None:
        """Write to the journal that a job runs, and under which name.

        Parameters
        ----------
        job
            A job that was taken.
        run_name
            The name that its run will have.

        Raises
        ------
        OSError
            If the disk refuses.
        """
        job.record = replace(job.record, run_name=run_name)
        self._journal.write(job.record)

    def assign_worker(self, job: Job, worker: Worker | None) -> None:
        """Note the worker that runs a job, so that canceling the job kills it.

        It is noted under the lock that `cancel` takes: no worker is killed that runs another job.

        Parameters
        ----------
        job
            The job.
        worker
            The worker that begins, None when it is released.
        """
        with self._changed:
            job.worker = worker
            if worker is not None and job.cancel_requested:
                worker.kill_soon()

    def report(self, job: Job, progress: dict[str, Any]) -> None:
        """Note how far a job is.

        Parameters
        ----------
        job
            The job.
        progress
            As clients see it.
        """
        job.progress = progress

    # how it ends

    def cancel(self, job_id: str, orphan: JobRecord | None = None) -> None:
        """Cancel a queued job, or stop a running one; one that has ended stays as it is.

        Parameters
        ----------
        job_id
            Of a job of this server, or of the orphan.
        orphan
            A queued job that is adopted to be canceled, if it was not adopted meanwhile.

        Raises
        ------
        NotFoundError
            If there is no such job.
        ConflictError
            If another server runs it.
        Problem
            503 if the journal cannot be written.
        """
        with self._changed:
            record = self.find(job_id)
            if record is None:
                raise not_found(job_id)
            if record.has_ended:
                return
            job = self._jobs.get(job_id)
            if job is None and orphan is not None:
                canceled = replace(orphan, state="cancelled", ended=utc_now())
                self._write_or_refuse(canceled)
                self.restore(canceled)
                return
            if job is None:
                raise ConflictError(f"job {job_id}: belongs to another server; cancel it there")
            if job.record.state == "queued":
                self._cancel_queued(job)
                return
            job.cancel_requested = True
            if job.worker is not None:
                job.worker.kill_soon()

    def _cancel_queued(self, job: Job) -> None:
        """Write that a queued job is canceled; what the other servers see is so here too.

        An error of the disk may come after the record is written: the job is canceled then, though
        that is not acknowledged, and its record is written again by `write_endings`.
        """
        record = replace(job.record, state="cancelled", ended=utc_now())
        try:
            self._write_or_refuse(record)
        except Problem:
            written = self._journal.get(record.id)
            if written is None or not written.has_ended:
                raise
            self._unwritten[record.id] = record
            job.record = record
            raise
        job.record = record

    def finish(self, job: Job, ending: Ending) -> None:
        """Record how a job ended; what the disk refuses is tried again by `write_endings`.

        Parameters
        ----------
        job
            The job.
        ending
            How it ended; one that was stopped and failed for that counts as `cancelled`.
        """
        was_canceled = job.cancel_requested and ending.error is not None
        state: JobState = "cancelled" if was_canceled else ending.state
        error = None if was_canceled else ending.error
        with self._changed:
            record = replace(job.record, state=state, error=error, ended=utc_now())
            self._unwritten[record.id] = record
            self.write_endings()
            job.record = record
            self.trim()

    def write_endings(self) -> None:
        """Write the endings to the journal that the disk has refused so far."""
        with self._changed:
            for job_id, record in list(self._unwritten.items()):
                try:
                    self._write(record)
                except OSError:  # logged; it may be this file alone that is refused
                    continue
                del self._unwritten[job_id]

    def trim(self) -> None:
        """Forget all but the newest `KEPT` jobs that have ended."""
        with self._changed:
            ended = [job.record for job in self._jobs.values() if job.record.has_ended]
            for record in sorted(ended, key=lambda each: each.ended or "")[:-KEPT]:
                del self._jobs[record.id]
                self._unwritten.pop(record.id, None)
                self._journal.forget(record.id)

    def close(self) -> None:
        """Let no job be taken any more, and wake the threads that wait for one."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _write_or_refuse(self, record: JobRecord) -> None:
        """Write what will be acknowledged; raise a Problem with 503 if the disk refuses."""
        try:
            self._write(record)
        except OSError:
            raise busy(503, "jobs: the journal cannot be written; retry after 30 s", 30) from None

    def _write(self, record: JobRecord) -> None:
        """Write to the journal; a job's refusal is logged once until the disk takes a record."""
        try:
            self._journal.write(record)
        except OSError as error:
            if record.id not in self._refused:
                self._refused.add(record.id)
                text = str(error)
                log_event("journal not written", level=logging.ERROR, job=record.id, error=text)
            raise
        self._refused.clear()


def not_found(job_id: str) -> NotFoundError:
    """Return the error for a job that no server has.

    Parameters
    ----------
    job_id
        The id that was looked for.
    """
    return NotFoundError(f"job: no job has the id {job_id}")


def utc_now() -> str:
    """Return the time as records have it, ISO 8601 in UTC."""
    return datetime.now(UTC).isoformat()
