"""The jobs that a server knows: its own as they are now, the others' as they are journalled."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from threading import Condition
from typing import Any

from ssil_service.jobs.journal import ENDED, KEPT, JobRecord, Journal
from ssil_service.jobs.runner import Ending
from ssil_service.logs import log_event
from ssil_service.problems import busy
from ssil_service.workers.pool import Worker


@dataclass
class Job:
    """A job of this server: its record, its progress, and the process that it runs in."""

    record: JobRecord
    progress: dict[str, Any] | None = None
    worker: Worker | None = None
    cancelled: bool = False


@dataclass
class JobRegistry:
    """Entries by job; `changed` is the lock under which they change."""

    journal: Journal
    entries: dict[str, Job] = field(default_factory=dict)
    changed: Condition = field(default_factory=Condition)
    _unwritten: dict[str, JobRecord] = field(default_factory=dict)

    def find(self, job: str) -> JobRecord | None:
        """Return a job's record, whichever server's it is."""
        entry = self.entries.get(job)
        return self.journal.read(job) if entry is None else entry.record

    def records(self) -> list[JobRecord]:
        """Return all servers' records, the oldest first; of this server's, what it knows itself."""
        records = {record.job: record for record in self.journal.all()}
        records |= {job: entry.record for job, entry in self.copy().items()}
        return sorted(records.values(), key=lambda record: record.created)

    def reserved_names(self, dataset: str) -> set[str]:
        """Return the names of the runs of a dataset that jobs are yet to make."""
        return {each.run for each in self.records() if each.dataset == dataset and not each.over}

    def copy(self) -> dict[str, Job]:
        """Return the entries as they are now."""
        with self.changed:
            return dict(self.entries)

    def counts(self) -> dict[str, int]:
        """Count this server's jobs by state."""
        states = [entry.record.state for entry in self.copy().values()]
        return {state: states.count(state) for state in ("queued", "running", *ENDED)}

    def keep(self, record: JobRecord) -> None:
        """Journal what will be acknowledged; raises a Problem with 503 if the disk refuses."""
        try:
            self.journal.write(record)
        except OSError as error:
            log_event("journal not written", level=logging.ERROR, job=record.job, error=str(error))
            raise busy(503, "jobs: expected a journal to write to, found it refused", 30) from None

    def end(self, entry: Job, ending: Ending) -> None:
        """Write down how a job ended; what the disk refuses is tried again with the next one."""
        state = "cancelled" if entry.cancelled and ending.error else ending.state
        error = None if state == "cancelled" else ending.error
        with self.changed:
            record = replace(entry.record, state=state, error=error, ended=now())
            self._unwritten[record.job] = record
            self._write()
            entry.record = record
            self.trim()

    def _write(self) -> None:
        for job, record in list(self._unwritten.items()):
            try:
                self.journal.write(record)
            except OSError as error:
                log_event("journal not written", level=logging.ERROR, job=job, error=str(error))
                return
            del self._unwritten[job]

    def trim(self) -> None:
        """Forget all but the newest ended jobs."""
        ended = [entry.record for entry in self.entries.values() if entry.record.over]
        for record in sorted(ended, key=lambda each: each.ended or "")[:-KEPT]:
            del self.entries[record.job]
            self.journal.forget(record.job)


def now() -> str:
    """Return the time as records have it."""
    return datetime.now(UTC).isoformat()
