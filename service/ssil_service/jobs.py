"""Scoring jobs: accepted durably, run in worker processes, found again after a crash."""

from __future__ import annotations

import secrets
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from threading import Condition, Thread
from typing import Any

from ssil_data.errors import ConflictError, NotFoundError, SsilDataError
from ssil_data.runs import Run
from ssil_data.store import Store
from ssil_service.pool import Pool, TaskError, Worker
from ssil_service.problems import Problem, busy, of_library
from ssil_service.state import KEPT, State

ENDED = ("succeeded", "failed", "cancelled")
_STOPPED = {"kind": "ServerStoppedError", "detail": "the server stopped while the job ran"}


@dataclass(frozen=True)
class JobRecord:
    """A job as it is journalled; times are ISO 8601 in UTC."""

    job: str
    server: str
    key: str | None
    dataset: str
    version: str
    body: Mapping[str, Any]
    created: str
    state: str = "queued"
    run: str | None = None
    error: Mapping[str, str] | None = None
    started: str | None = None
    ended: str | None = None

    def shown(self, progress: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return what clients see."""
        hidden = ("server", "key", "version", "body")
        known = {name: value for name, value in asdict(self).items() if name not in hidden}
        return {**known, "progress": progress}


@dataclass
class _Entry:
    """A job of this server: its record, its progress, and the process that it runs in."""

    record: JobRecord
    progress: dict[str, Any] | None = None
    worker: Worker | None = None
    cancelled: bool = False


@dataclass
class Board:
    """All jobs of this server, and a view of the others' of the same store."""

    store: str
    state: State
    pool: Pool
    running: int
    queue: int
    _entries: dict[str, _Entry] = field(default_factory=dict)
    _changed: Condition = field(default_factory=Condition)
    _closing: bool = False

    def start(self) -> None:
        """Take over what dead servers left, and begin to run jobs."""
        with self.state.orphans() as dead:
            records = [JobRecord(**record) for record in self.state.records()]
            for record in sorted(records, key=lambda record: record.created):
                if record.server in dead and record.state not in ENDED:
                    self._take_over(record)
                elif record.state in ENDED:
                    self._entries[record.job] = _Entry(record)
        self.state.forget([job for job, entry in self._entries.items() if _over(entry)])
        for number in range(self.running):
            Thread(target=self._work, name=f"job-{number}", daemon=True).start()

    def _take_over(self, record: JobRecord) -> None:
        entry = self._entries[record.job] = _Entry(replace(record, server=self.state.server))
        if record.state == "queued":
            self.state.write(record.job, asdict(entry.record))
        else:
            self._end(entry, error=_STOPPED)

    def submit(
        self, dataset: str, version: str, body: Mapping[str, Any], key: str | None
    ) -> dict[str, Any]:
        """Accept a job, or return the one that was accepted under the same key.

        Raises a Problem with 429 when the queue is full, 409 for a key used for another body.
        """
        with self._changed:
            known = self._of_key(key)
            if known is not None:
                same = (known.record.dataset, known.record.body) == (dataset, body)
                if not same:
                    raise Problem(409, "Idempotency-Key: expected another, found it used before")
                return known.record.shown(known.progress)
            unfinished = sum(not _over(entry) for entry in self._entries.values())
            if unfinished >= self.queue + self.running or self._closing:
                raise busy(429, "jobs: expected a free place, found the queue full", 5)
            record = JobRecord(
                job=secrets.token_hex(8),
                server=self.state.server,
                key=key,
                dataset=dataset,
                version=version,
                body=body,
                created=_now(),
            )
            self.state.write(record.job, asdict(record))
            self._entries[record.job] = _Entry(record)
            self._changed.notify()
            return record.shown()

    def _of_key(self, key: str | None) -> _Entry | None:
        entries = self._entries.values()
        return next((e for e in entries if key is not None and e.record.key == key), None)

    def get(self, job: str) -> dict[str, Any]:
        """Return a job as clients see it; raises NotFoundError."""
        entry = self._entries.get(job)
        if entry is not None:
            return entry.record.shown(entry.progress)
        record = self.state.read(job) if job.isalnum() else None
        if record is None:
            raise NotFoundError("job: expected one of the service's, found another")
        return JobRecord(**record).shown()

    def all(self) -> list[dict[str, Any]]:
        """Return all jobs of the store's servers, the newest first."""
        others = [JobRecord(**record) for record in self.state.records()]
        shown = {record.job: record.shown() for record in others}
        shown |= {job: entry.record.shown(entry.progress) for job, entry in self._copy().items()}
        return sorted(shown.values(), key=lambda job: job["created"], reverse=True)

    def counts(self) -> dict[str, int]:
        """Count this server's jobs by state."""
        states = [entry.record.state for entry in self._copy().values()]
        return {state: states.count(state) for state in ("queued", "running", *ENDED)}

    def cancel(self, job: str) -> dict[str, Any]:
        """Stop a job; one that has ended stays as it is.

        Raises NotFoundError, or ConflictError for a job of another server.
        """
        with self._changed:
            entry = self._entries.get(job)
            if entry is None:
                self.get(job)
                raise ConflictError(f"job {job}: expected one of this server, found another's")
            if not _over(entry):
                entry.cancelled = True
                if entry.record.state == "queued":
                    self._finish(entry, state="cancelled")
                elif entry.worker is not None:
                    entry.worker.kill_soon()
            return entry.record.shown(entry.progress)

    def close(self, grace: float) -> None:
        """Let running jobs end for `grace` seconds; queued ones are left to the next server."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        deadline = time.monotonic() + grace
        while self.counts()["running"] and time.monotonic() < deadline:
            time.sleep(0.05)
        self.pool.close()
        deadline = time.monotonic() + 5
        while self.counts()["running"] and time.monotonic() < deadline:
            time.sleep(0.05)

    def _copy(self) -> dict[str, _Entry]:
        with self._changed:
            return dict(self._entries)

    def _work(self) -> None:
        while True:
            with self._changed:
                while not self._closing and self._next() is None:
                    self._changed.wait()
                entry = None if self._closing else self._next()
                if entry is None:
                    return
                entry.record = replace(entry.record, state="running", started=_now())
            self.state.write(entry.record.job, asdict(entry.record))
            self._run(entry)

    def _next(self) -> _Entry | None:
        waiting = (entry for entry in self._entries.values() if entry.record.state == "queued")
        return next(waiting, None)

    def _run(self, entry: _Entry) -> None:
        record = entry.record
        arguments = {"store": self.store, "dataset": record.dataset}
        arguments |= {"version": record.version, "body": dict(record.body)}

        def started(worker: Worker) -> None:
            entry.worker = worker
            if entry.cancelled:
                worker.kill_soon()

        def report(progress: dict[str, Any]) -> None:
            entry.progress = progress

        try:
            made = self.pool.run("make_run", arguments, report=report, started=started)
        except (SsilDataError, Problem) as error:
            self._end(entry, error={"kind": type(error).__name__, "detail": self._told(error)})
        except TaskError as error:
            told = {"kind": error.kind, "detail": error.detail}
            self._end(entry, error=_STOPPED if self._closing else told)
        else:
            self._finish(entry, state="succeeded", run=made["run"])

    def _told(self, error: SsilDataError | Problem) -> str:
        """Return an error's message without the places on the machine that it names."""
        if isinstance(error, Problem):
            return error.detail
        return of_library(error, [Store(self.store).folder.uri]).detail

    def _end(self, entry: _Entry, *, error: Mapping[str, str]) -> None:
        """End a job that gave no answer: it may have made its run before it stopped."""
        made = self._made_run(entry.record)
        if made is not None:
            self._finish(entry, state="succeeded", run=made.run)
        elif entry.cancelled:
            self._finish(entry, state="cancelled")
        else:
            self._finish(entry, state="failed", error=error)

    def _made_run(self, record: JobRecord) -> Run | None:
        """Find the run of a job that was cut off: made since, as asked, and no other job's."""
        records = [entry.record for entry in self._copy().values()]
        taken = {other.run for other in records if other.dataset == record.dataset}
        try:
            runs = Store(self.store)[record.dataset].runs.all()
        except SsilDataError:
            return None
        since = record.started or record.created
        made = [run for run in runs if run.created >= since and run.run not in taken]
        return next((run for run in made if _as_asked(run, record)), None)

    def _finish(self, entry: _Entry, **change: Any) -> None:
        entry.record = replace(entry.record, ended=_now(), **change)
        entry.worker = None
        self.state.write(entry.record.job, asdict(entry.record))
        ended = [job for job, other in self._copy().items() if _over(other)]
        for job in ended[:-KEPT]:
            self._entries.pop(job, None)


def _as_asked(run: Run, record: JobRecord) -> bool:
    body = record.body
    if run.dataset_version != record.version or body["run"] not in (None, run.run):
        return False
    if "fitted" in body:
        return True
    same = ("estimator", "scale", "labeled_is_one", "seed")
    return all(getattr(run, name) == body[name] for name in same)


def _over(entry: _Entry) -> bool:
    return entry.record.state in ENDED


def _now() -> str:
    return datetime.now(UTC).isoformat()
