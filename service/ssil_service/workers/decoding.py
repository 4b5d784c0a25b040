"""Bodies that only a process of its own may open: Parquet, and everything that is uploaded."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ssil_service.logs import log_event
from ssil_service.problems import Problem, busy
from ssil_service.workers.lease import ServerLease
from ssil_service.workers.pool import Pool, TaskError

_AT_ONCE, _WAITING = 2, 16
_FAULTS = {
    "MemoryError": (413, "body: expected to decode within the limit of memory, found more"),
    "ArrowMemoryError": (413, "body: expected to decode within the limit of memory, found more"),
    "CrashError": (422, "body: expected a readable file, found one that its parser dies of"),
    "TimeoutError": (413, "body: expected a file that is read soon, found one that takes too long"),
}
_OWN = (500, "service: expected an answer, found a fault of its own")
_LATER = {
    "ShutdownError": "service: expected time for an answer, found it shutting down",
    "StartError": "service: expected a process to decode in, found none that could be started",
}


class Decoder:
    """Hands bodies to worker processes: a crash or a bomb ends a worker, not the service.

    A body is to blame for what happens while it is read, and for a crash only if a second worker
    dies of it too; what happens afterwards is the service's own fault.
    """

    def __init__(
        self, state: ServerLease, pool: Pool, *, query_rows: int, upload_rows: int
    ) -> None:
        self.state = state
        self.pool = pool
        self._rows = {"decode": query_rows, "upload": upload_rows}
        self._places = asyncio.Semaphore(_AT_ONCE)
        self._admitted = {"decode": 0, "upload": 0}

    async def arrow(self, body: bytes) -> bytes:
        """Return a Parquet body as an Arrow stream."""
        with (
            self._admission("decode"),
            self.state.scratch() as source,
            self.state.scratch() as target,
        ):
            source.write_bytes(body)
            await self._run("decode", source=str(source), target=str(target))
            return target.read_bytes()

    async def upload(self, chunks: AsyncIterator[bytes], **arguments: Any) -> str:
        """Write a body to the disk as it arrives, then to the store; return the new version."""
        with self._admission("upload"), self.state.scratch() as source:
            await _save(chunks, source)
            return await self._run("upload", source=str(source), **arguments)

    @contextmanager
    def _admission(self, task: str) -> Iterator[None]:
        """Take a place before anything of the body is received or kept."""
        if self._admitted[task] >= _AT_ONCE + _WAITING:
            raise busy(503, "service: expected a free place to decode, found the queue full", 2)
        self._admitted[task] += 1
        try:
            yield
        finally:
            self._admitted[task] -= 1

    async def _run(self, task: str, **arguments: Any) -> Any:
        arguments["most_rows"] = self._rows[task]
        async with self._places:
            return await asyncio.shield(asyncio.to_thread(self._run_with_retry, task, arguments))

    def _run_with_retry(self, task: str, arguments: dict[str, Any]) -> Any:
        """Run a task; a crash while the body is read is no proof until it happens again."""
        for last in (False, True):
            read = False

            def report(progress: dict[str, Any]) -> None:
                nonlocal read
                read = read or (progress["what"] == "read" and progress["done"] == progress["of"])

            try:
                return self.pool.run(task, arguments, report=report)
            except TaskError as error:
                if error.kind == "CrashError" and not read and not last:
                    log_event("retried", level=30, task=task)
                    continue
                if error.kind in _LATER:
                    later = busy(503, _LATER[error.kind], 1)
                    if read:  # it may be written: nobody is told to repeat it
                        later = Problem(503, f"{later.detail}; look before you repeat it")
                    raise later from None
                blame = _FAULTS.get(error.kind, _OWN)
                raise Problem(*(_OWN if read else blame)) from None
        raise AssertionError("the second time returns or raises")


async def _save(chunks: AsyncIterator[bytes], path: Path) -> None:
    with path.open("wb") as file:
        async for chunk in chunks:
            file.write(chunk)
