"""A bounded memory of what was read or built for a question."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Any


class Cache:
    """The values used last, up to a number of bytes; one build for all who ask; of one loop."""

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.bytes = self.hits = self.misses = 0
        self._kept: OrderedDict[Hashable, tuple[Any, int]] = OrderedDict()
        self._building: dict[Hashable, asyncio.Future[Any]] = {}
        self._changing = Lock()

    def __len__(self) -> int:
        """Count the values."""
        return len(self._kept)

    def peek(self, key: Hashable) -> Any | None:
        """Return a value that is there, or None."""
        with self._changing:
            if key not in self._kept:
                return None
            self._kept.move_to_end(key)
            self.hits += 1
            return self._kept[key][0]

    async def get(self, key: Hashable, build: Callable[[], tuple[Any, int]]) -> Any:
        """Return a value, built in a thread with its size in bytes if it is not there."""
        found = self.peek(key)
        if found is not None:
            return found
        if key not in self._building:
            self.misses += 1
            self._building[key] = asyncio.ensure_future(self._build(key, build))
        return await asyncio.shield(self._building[key])

    async def _build(self, key: Hashable, build: Callable[[], tuple[Any, int]]) -> Any:
        try:
            value, size = await asyncio.to_thread(build)
        finally:
            del self._building[key]
        with self._changing:
            self._kept[key] = (value, size)
            self.bytes += size
            while self.bytes > self.capacity and len(self._kept) > 1:
                _, (_, freed) = self._kept.popitem(last=False)
                self.bytes -= freed
        return value

    def forget(self, chosen: Callable[[Any], bool]) -> None:
        """Let go of the values whose keys are chosen; any thread may."""
        with self._changing:
            for key in [key for key in self._kept if chosen(key)]:
                self.bytes -= self._kept.pop(key)[1]
