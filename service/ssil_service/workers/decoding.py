"""Bodies that only a worker process may open: Parquet, and everything that is uploaded."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ssil_service.logs import log_event
from ssil_service.problems import Problem, busy, of_fault
from ssil_service.workers.lease import ServerLease
from ssil_service.workers.pool import Pool
from ssil_service.workers.tasks import Phase
from ssil_service.workers.worker import TaskError

_RUNNING_LIMIT = 2
"""Bodies that are decoded at once."""
_ADMITTED_LIMIT = 18
"""Bodies of a task that are received, waiting or decoded at once; more are refused."""
_TOO_MUCH_MEMORY = (413, "body: takes more memory to decode than is allowed")
_BODY_FAULTS = {
    "MemoryError": _TOO_MUCH_MEMORY,
    "ArrowMemoryError": _TOO_MUCH_MEMORY,
    "CrashError": (422, "body: crashes the parser, so it is not a readable file"),
    "TimeoutError": (413, "body: takes longer to read than is allowed"),
}
"""Answers to errors of a task that was reading the body."""
_UNAVAILABLE = {
    "ShutdownError": "The service is shutting down",
    "StartError": "No process to decode in could be started",
}
"""Reasons for 503: neither the body nor the task is at fault."""


@dataclass
class _Attempt:
    """One run of a task in a worker: the phase that it reached, and its result or its error."""

    phase: Phase = "reading"
    result: Any = None
    error: TaskError | None = None

    def enter(self, phase: Phase) -> None:
        self.phase = phase

    @property
    def has_crashed_while_reading(self) -> bool:
        crashed = self.error is not None and self.error.kind == "CrashError"
        return crashed and self.phase == "reading"


class Decoder:
    """Decodes bodies in worker processes: a crash or a bomb ends a worker, not the service.

    A body is to blame for what happens while it is read, and for a crash only if a second worker
    crashes too. What fails after it was read is the service's own fault.

    Parameters
    ----------
    lease
        Where bodies are kept meanwhile.
    pool
        Workers.
    query_rows
        Most rows of a query's body.
    upload_rows
        Most rows of an upload.
    """

    def __init__(
        self, lease: ServerLease, pool: Pool, *, query_rows: int, upload_rows: int
    ) -> None:
        self.lease = lease
        self.pool = pool
        self._row_limits = {"decode": query_rows, "upload": upload_rows}
        self._running = asyncio.Semaphore(_RUNNING_LIMIT)
        self._admitted = {"decode": 0, "upload": 0}

    async def arrow(self, body: bytes) -> bytes:
        """Convert a Parquet body.

        Parameters
        ----------
        body
            A Parquet file.

        Returns
        -------
        bytes
            The same table as an Arrow IPC stream.

        Raises
        ------
        Problem
            413 or 422 if the body cannot be read, 503 if there is no room now.
        """
        with (
            self._admit("decode"),
            self.lease.temporary_file() as source,
            self.lease.temporary_file() as target,
        ):
            source.write_bytes(body)
            await self._run("decode", source=str(source), target=str(target))
            return target.read_bytes()

    async def upload(self, chunks: AsyncIterator[bytes], **arguments: Any) -> str:
        """Write a body to the disk as it arrives, then to the store.

        Parameters
        ----------
        chunks
            The body.
        **arguments
            Of `ssil_service.workers.tasks.upload`.

        Returns
        -------
        str
            Version of the dataset with the upload.

        Raises
        ------
        Problem
            413 or 422 if the body cannot be read, 503 if there is no room now; 503 without
            `Retry-After` and 500 leave open whether the change was made.
        SsilDataError
            If the store refuses the upload.
        """
        with self._admit("upload"), self.lease.temporary_file() as source:
            await _save(chunks, source)
            return await self._run("upload", source=str(source), **arguments)

    @contextmanager
    def _admit(self, task: str) -> Iterator[None]:
        """Count a body before any of it is received; raise a Problem if there are too many."""
        if self._admitted[task] >= _ADMITTED_LIMIT:
            raise busy(
                503, f"Too many bodies to decode (limit {_ADMITTED_LIMIT}); retry after 2 s", 2
            )
        self._admitted[task] += 1
        try:
            yield
        finally:
            self._admitted[task] -= 1

    async def _run(self, task: str, **arguments: Any) -> Any:
        arguments["most_rows"] = self._row_limits[task]
        async with self._running:
            return await asyncio.shield(asyncio.to_thread(self._run_with_retry, task, arguments))

    def _run_with_retry(self, task: str, arguments: dict[str, Any]) -> Any:
        """Retry once: blame the body only if a second worker crashes while reading it."""
        attempt = self._attempt(task, arguments)
        if attempt.has_crashed_while_reading:
            log_event("task retried after a crash", level=logging.WARNING, task=task)
            attempt = self._attempt(task, arguments)
        if attempt.error is not None:
            raise _explain(attempt.error, attempt.phase)
        return attempt.result

    def _attempt(self, task: str, arguments: dict[str, Any]) -> _Attempt:
        """Run a task once; raises only what the request is to blame for."""
        attempt = _Attempt()
        try:
            attempt.result = self.pool.run(task, arguments, enter_phase=attempt.enter)
        except TaskError as error:
            attempt.error = error
        return attempt


def _explain(error: TaskError, phase: Phase) -> Problem:
    """Return the problem that a failed task is answered with, by the phase in which it failed."""
    if error.kind in _UNAVAILABLE:
        reason = _UNAVAILABLE[error.kind]
        if phase == "reading":
            return busy(503, f"{reason}; retry after 1 s", 1)
        return Problem(503, f"{reason}; the change may have been made: check before repeating it")
    if phase == "reading" and error.kind in _BODY_FAULTS:
        return Problem(*_BODY_FAULTS[error.kind])
    return of_fault(error)


async def _save(chunks: AsyncIterator[bytes], path: Path) -> None:
    with path.open("wb") as file:
        async for chunk in chunks:
            file.write(chunk)
