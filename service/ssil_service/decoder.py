"""Bodies that only a process of its own may open: Parquet, and everything that is uploaded."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from ssil_service.pool import Pool, TaskError
from ssil_service.problems import Problem, busy
from ssil_service.state import State

_AT_ONCE, _WAITING = 2, 16
_FAULTS = {
    "MemoryError": (413, "body: expected to decode within the limit of memory, found more"),
    "ArrowMemoryError": (413, "body: expected to decode within the limit of memory, found more"),
    "CrashError": (422, "body: expected a readable file, found one that its parser dies of"),
    "TimeoutError": (422, "body: expected a file that is read soon, found one that takes too long"),
    "ShutdownError": (503, "service: expected time for an answer, found it shutting down"),
}


class Decoder:
    """Hands bodies to worker processes: a crash or a bomb ends a worker, not the service."""

    def __init__(self, state: State, pool: Pool, *, query_rows: int, upload_rows: int) -> None:
        self.state = state
        self.pool = pool
        self._rows = {"decode": query_rows, "upload": upload_rows}
        self._places = asyncio.Semaphore(_AT_ONCE)
        self._admitted = 0

    async def arrow(self, body: bytes) -> bytes:
        """Return a Parquet body as an Arrow stream."""
        with self.state.scratch() as source, self.state.scratch() as target:
            source.write_bytes(body)
            await self._run("decode", source=str(source), target=str(target))
            return target.read_bytes()

    async def upload(self, chunks: AsyncIterator[bytes], **arguments: Any) -> str:
        """Write a body to the disk as it arrives, then to the store; return the new version."""
        with self.state.scratch() as source:
            await _kept(chunks, source)
            return await self._run("upload", source=str(source), **arguments)

    async def _run(self, task: str, **arguments: Any) -> Any:
        if self._admitted >= _AT_ONCE + _WAITING:
            raise busy(503, "service: expected a free place to decode, found the queue full", 2)
        self._admitted += 1
        arguments["most_rows"] = self._rows[task]
        try:
            async with self._places:
                work = asyncio.to_thread(self.pool.run, task, arguments)
                return await asyncio.shield(work)
        except TaskError as error:
            detail = (500, "service: expected an answer, found a fault of its own")
            raise Problem(*_FAULTS.get(error.kind, detail)) from None
        finally:
            self._admitted -= 1


async def _kept(chunks: AsyncIterator[bytes], path: Path) -> None:
    with path.open("wb") as file:
        async for chunk in chunks:
            file.write(chunk)
