"""Which of body, task and service is to blame when a worker fails."""

import asyncio
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest

from ssil_service.problems import Problem
from ssil_service.workers.decoding import Decoder
from ssil_service.workers.lease import ServerLease
from ssil_service.workers.tasks import Phase
from ssil_service.workers.worker import TaskError


class Workers:
    """A pool whose workers end one after the other as listed: None answers, a kind fails."""

    def __init__(self, *ends: str | None, writing: bool = False) -> None:
        self.ends = list(ends)
        self.writing = writing

    def run(self, task: str, arguments: Any, *, enter_phase: Callable[[Phase], None]) -> str:
        """Answer, or fail, after the phase of writing was entered or before."""
        if self.writing:
            enter_phase("writing")
        end = self.ends.pop(0)
        if end is not None:
            raise TaskError(end, "status -11")
        return "version"


def upload(workers: Workers, folder: Path) -> str:
    """Upload a body through a decoder; return the version that the workers answer with."""

    async def body() -> AsyncIterator[bytes]:
        yield b"x"

    async def decode() -> str:
        pool: Any = workers
        return await Decoder(lease, pool, query_rows=1, upload_rows=1).upload(body())

    lease = ServerLease(folder)
    try:
        return asyncio.run(decode())
    finally:
        lease.close()


def test_one_crash_is_no_proof_against_a_body(tmp_path: Path):
    assert upload(Workers("CrashError", None), tmp_path) == "version"


@pytest.mark.parametrize(
    ("ends", "writing", "status"),
    [
        (["CrashError", "CrashError"], False, 422),
        (["TimeoutError"], False, 413),
        (["MemoryError"], False, 413),
        (["InternalError"], False, 500),
        (["StartError"], False, 503),
        (["CrashError"], True, 500),
        (["TimeoutError"], True, 500),
        (["MemoryError"], True, 500),
    ],
)
def test_a_body_is_to_blame_only_while_it_is_read(
    ends: list[str], writing: bool, status: int, tmp_path: Path
):
    workers = Workers(*ends, writing=writing)
    with pytest.raises(Problem) as refusal:
        upload(workers, tmp_path)
    assert refusal.value.status == status
    assert not workers.ends


@pytest.mark.parametrize(("writing", "may_retry"), [(False, True), (True, False)])
def test_an_upload_that_may_be_written_at_shutdown_is_not_to_be_retried(
    writing: bool, may_retry: bool, tmp_path: Path
):
    with pytest.raises(Problem) as refusal:
        upload(Workers("ShutdownError", writing=writing), tmp_path)
    assert refusal.value.status == 503
    assert ("Retry-After" in refusal.value.headers) == may_retry
