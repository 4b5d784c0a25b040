"""What the routes work with: one object, made with the application."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from fastapi import Request

from ssil_data.client.wire import JSON
from ssil_service.jobs.queue import JobQueue
from ssil_service.metrics import Metrics
from ssil_service.queries.admission import BoundedExecutor
from ssil_service.queries.batching import Batching
from ssil_service.queries.catalog import Catalog
from ssil_service.security.authentication import Keys
from ssil_service.settings import Settings
from ssil_service.workers.decoding import Decoder
from ssil_service.workers.lease import ServerLease

Answer = TypeVar("Answer")
INLINE = 2**21
"""Pairs of a query and a demonstration state, some two milliseconds, that wait for no thread."""


@dataclass
class Context:
    """The parts of a running service."""

    settings: Settings
    keys: Keys
    metrics: Metrics
    lease: ServerLease
    catalog: Catalog
    executor: BoundedExecutor
    json_executor: BoundedExecutor
    decoder: Decoder
    jobs: JobQueue
    store_folder: Path | None
    """The folder that the store was in when the service began."""
    batching: Batching = field(default_factory=lambda: Batching(INLINE))
    closing: bool = False
    _deadline: float | None = None

    def executor_for(self, media: str) -> BoundedExecutor | None:
        """Return where a long body or answer of a form waits: JSON's, as it lets nobody else run.

        It also takes up to thirty times its length while it is read: one at a time.
        """
        return self.json_executor if media == JSON else None

    async def compute(self, pairs: int, work: Callable[[], Answer]) -> Answer:
        """Compute a small question at once, a large one behind the gate."""
        return work() if pairs <= INLINE else await self.executor.run(work)

    def begin_shutdown(self) -> None:
        """Begin to end: what was accepted has the seconds of grace from now on, all together."""
        self.closing = True
        if self._deadline is None:
            self._deadline = time.monotonic() + self.settings.grace_seconds

    def close(self) -> None:
        """Finish what was accepted, and give up the place in the state folder."""
        self.begin_shutdown()
        self.executor.close(self._seconds_left())
        self.json_executor.close(self._seconds_left())
        self.decoder.pool.close()
        self.jobs.close(self._seconds_left())
        self.lease.close()

    def _seconds_left(self) -> float:
        """Return the seconds of grace that are left."""
        assert self._deadline is not None
        return max(0.0, self._deadline - time.monotonic())


def context(request: Request) -> Context:
    """Return the parts of the service that a request came to."""
    return request.app.state.context
