"""Large questions wait in a short queue and are refused at once when it is full."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, TypeVar

from ssil_service.problems import busy

Answer = TypeVar("Answer")


class BoundedExecutor:
    """`computing` threads and `waiting` places before them; of one event loop.

    A question that its client has given up is still computed if it had begun: threads cannot be
    stopped, and its place is free only when it ends.
    """

    def __init__(self, computing: int, waiting: int) -> None:
        self._threads = ThreadPoolExecutor(computing, thread_name_prefix="compute")
        self._places = computing + waiting
        self._computing = computing
        self._typical = 0.1
        self._computed: set[Future[Any]] = set()
        self.admitted = 0
        self.refused = 0

    async def run(self, work: Callable[[], Answer]) -> Answer:
        """Compute in a thread; raises a Problem with 503 when the queue is full."""
        if self.admitted >= self._places:
            self.refused += 1
            ahead = self.admitted / self._computing
            raise busy(
                503, "service: expected a free place, found the queue full", ahead * self._typical
            )
        self.admitted += 1
        begin = time.monotonic()
        computed = self._threads.submit(work)
        self._computed.add(computed)
        computed.add_done_callback(self._computed.discard)
        future = asyncio.wrap_future(computed)
        future.add_done_callback(lambda _: self._finish(begin))
        return await asyncio.shield(future)

    def _finish(self, begin: float) -> None:
        self.admitted -= 1
        self._typical += 0.1 * (time.monotonic() - begin - self._typical)

    def close(self, seconds: float) -> None:
        """Wait for what is being computed, so many seconds; what has not begun is given up."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        wait(list(self._computed), timeout=seconds)
