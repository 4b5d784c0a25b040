"""Bounded queue for expensive work; a full queue answers 503 at once."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, TypeVar

from ssil_service.problems import busy

Answer = TypeVar("Answer")


class BoundedExecutor:
    """Threads with a bounded queue, for one event loop.

    Work that has begun goes on when its client has disconnected, as threads cannot be stopped; it
    counts as admitted until it ends.

    Parameters
    ----------
    computing
        Threads.
    waiting
        Work that may wait for them.

    Attributes
    ----------
    admitted
        Work in threads or queue now.
    refused
        Work refused since the start.
    """

    def __init__(self, computing: int, waiting: int) -> None:
        self._threads = ThreadPoolExecutor(computing, thread_name_prefix="compute")
        self._limit = computing + waiting
        self._computing = computing
        self._typical_seconds = 0.1
        self._in_threads: set[Future[Any]] = set()
        self.admitted = 0
        self.refused = 0

    async def run(self, work: Callable[[], Answer]) -> Answer:
        """Do work in a thread.

        Parameters
        ----------
        work
            To be called there.

        Returns
        -------
        Answer
            What `work` returns.

        Raises
        ------
        Problem
            503 if the queue is full, with the seconds after which there may be room.
        """
        if self.admitted >= self._limit:
            self.refused += 1
            seconds = self._typical_seconds * self.admitted / self._computing
            retry = max(1, math.ceil(seconds))
            raise busy(
                503, f"Too many large requests (limit {self._limit}); retry after {retry} s", retry
            )
        self.admitted += 1
        started_at = time.monotonic()
        computed = self._threads.submit(work)
        self._in_threads.add(computed)
        computed.add_done_callback(self._in_threads.discard)
        future = asyncio.wrap_future(computed)
        future.add_done_callback(lambda _: self._finish(started_at))
        return await asyncio.shield(future)

    def close(self, seconds: float) -> None:
        """Drop the queue, and wait until the threads have finished.

        Parameters
        ----------
        seconds
            How long to wait at most.
        """
        self._threads.shutdown(wait=False, cancel_futures=True)
        wait(list(self._in_threads), timeout=seconds)

    def _finish(self, started_at: float) -> None:
        self.admitted -= 1
        self._typical_seconds += 0.1 * (time.monotonic() - started_at - self._typical_seconds)
