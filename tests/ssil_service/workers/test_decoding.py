"""Who is to blame when a worker dies over a body."""

import asyncio
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest

from ssil_service.problems import Problem
from ssil_service.workers.decoding import Decoder
from ssil_service.workers.lease import ServerLease
from ssil_service.workers.pool import TaskError

READ = {"what": "read", "done": 1, "of": 1}


class Workers:
    """Stands for a pool whose workers end as they are told."""

    def __init__(self, *ends: str | None, progress: Any = None) -> None:
        self.ends, self.progress = list(ends), progress

    def run(self, task: str, arguments: Any, *, report: Callable[[Any], None]) -> str:
        """Answer, or fail."""
        if self.progress is not None:
            report(self.progress)
        end = self.ends.pop(0)
        if end is not None:
            raise TaskError(end, "status -11")
        return "version"


def uploaded(workers: Workers, place: Path) -> str:
    async def body() -> AsyncIterator[bytes]:
        yield b"x"

    async def upload() -> str:
        pool: Any = workers
        return await Decoder(state, pool, query_rows=1, upload_rows=1).upload(body())

    state = ServerLease(place)
    try:
        return asyncio.run(upload())
    finally:
        state.close()


def test_one_crash_is_no_proof_against_a_body(tmp_path: Path):
    assert uploaded(Workers("CrashError", None), tmp_path) == "version"


@pytest.mark.parametrize(
    ("ends", "progress", "status"),
    [
        (["CrashError", "CrashError"], None, 422),
        (["TimeoutError"], None, 413),
        (["MemoryError"], None, 413),
        (["InternalError"], None, 500),
        (["StartError"], None, 503),
        (["CrashError"], READ, 500),
        (["TimeoutError"], READ, 500),
        (["MemoryError"], READ, 500),
    ],
)
def test_a_body_is_to_blame_only_while_it_is_read(
    ends: list[str], progress: Any, status: int, tmp_path: Path
):
    workers = Workers(*ends, progress=progress)
    with pytest.raises(Problem) as refusal:
        uploaded(workers, tmp_path)
    assert refusal.value.status == status
    assert not workers.ends


@pytest.mark.parametrize(("progress", "again"), [(None, True), (READ, False)])
def test_what_may_be_written_at_the_end_is_not_asked_again(
    progress: Any, again: bool, tmp_path: Path
):
    with pytest.raises(Problem) as refusal:
        uploaded(Workers("ShutdownError", progress=progress), tmp_path)
    assert refusal.value.status == 503
    assert ("Retry-After" in refusal.value.headers) == again
