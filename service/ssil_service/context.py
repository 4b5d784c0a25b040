"""The parts of a running service, and where a route lets work be done.

A route runs in the event loop, which answers no other request meanwhile. There are three kinds of
work:

- numbers from numbers, `Context.compute`: a small query at once, a large one in the bounded
  executor for computation;
- bytes to arrays or back, `Context.convert`: a short body at once, long JSON in the executor for
  JSON, other long bodies in any thread;
- files, `asyncio.to_thread` or the catalog, which does it itself.
"""

from __future__ import annotations

import asyncio
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
from ssil_service.settings import Settings
from ssil_service.workers.decoding import Decoder
from ssil_service.workers.lease import ServerLease

Answer = TypeVar("Answer")
INLINE_PAIRS = 2**21
"""Pairs of a query and a demonstration state whose kernel takes some two milliseconds."""
INLINE_BYTES = 2**16
"""Bytes of a body that are read or written in well under a millisecond."""
COR_COST = 100
"""CoR of one state costs as much as the kernel of so many pairs, however many demonstrations."""
SCORE_COST = 4096
"""An estimator's answer for one state-action pair costs as much as the kernel of so many."""


@dataclass
class Context:
    """The parts of a running service, made when it starts and closed when it ends.

    Parameters
    ----------
    settings
        Limits and folders.
    metrics
        Where answers are counted.
    lease
        This server's folder among those of all servers of the store.
    catalog
        Datasets, fields and models, read from the store and cached.
    executor
        For large queries.
    json_executor
        For long JSON bodies and answers.
    decoder
        Worker processes for Parquet bodies and uploads.
    jobs
        Scoring jobs.
    store_folder
        The folder that the store was in at the start; None for an object store.
    batching
        Small LCoR queries of the same field, computed together.
    closing
        Whether the service is shutting down.
    """

    settings: Settings
    metrics: Metrics
    lease: ServerLease
    catalog: Catalog
    executor: BoundedExecutor
    json_executor: BoundedExecutor
    decoder: Decoder
    jobs: JobQueue
    store_folder: Path | None = None
    batching: Batching = field(default_factory=lambda: Batching(INLINE_PAIRS))
    closing: bool = False
    _deadline: float | None = None

    async def compute(self, pairs: int, work: Callable[[], Answer]) -> Answer:
        """Compute the answer to a query.

        Parameters
        ----------
        pairs
            What it costs, in pairs of a query and a demonstration state.
        work
            Computes it, at once if it is small, in the executor otherwise.

        Returns
        -------
        Answer
            What `work` returns.

        Raises
        ------
        Problem
            503 if too many large queries wait.
        """
        return work() if pairs <= INLINE_PAIRS else await self.executor.run(work)

    async def convert(self, size: int, work: Callable[[], Answer], media: str) -> Answer:
        """Read a body into arrays, or write arrays as the body of an answer.

        Parameters
        ----------
        size
            Bytes of the body, about.
        work
            Reads or writes it, at once if it is short, in a thread otherwise.
        media
            Media type of the body.

        Returns
        -------
        Answer
            What `work` returns.

        Raises
        ------
        Problem
            503 if too much long JSON waits.
        """
        if size <= INLINE_BYTES:
            return work()
        executor = self.executor_for(media)
        return await (asyncio.to_thread(work) if executor is None else executor.run(work))

    def executor_for(self, media: str) -> BoundedExecutor | None:
        """Return the executor in which long bodies of a media type are read and written.

        Parsing JSON holds Python's interpreter lock and takes many times the body's length in
        memory, so JSON has an executor with a single thread.

        Parameters
        ----------
        media
            The media type.

        Returns
        -------
        BoundedExecutor or None
            None for media types of which any number may be converted at once.
        """
        return self.json_executor if media == JSON else None

    def begin_shutdown(self) -> None:
        """Start the seconds of grace that requests and jobs have, all together, to finish."""
        self.closing = True
        if self._deadline is None:
            self._deadline = time.monotonic() + self.settings.grace_seconds

    def close(self) -> None:
        """Finish what was accepted, as far as the seconds of grace allow, and end the lease."""
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
    """Return the parts of the service that a request came to.

    Parameters
    ----------
    request
        Any request to the application, after it has started.

    Returns
    -------
    Context
        The one of its application.
    """
    return request.app.state.context
