"""A cache of what was read or built for queries, bounded in bytes."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Hashable
from threading import Lock
from typing import Any


class Cache:
    """The values used last; several requests for one value build it once. For one event loop.

    Parameters
    ----------
    capacity
        Bytes that the values may take together. A single value may be larger: the one used last
        always stays.

    Attributes
    ----------
    bytes
        Bytes that the values take now.
    hits
        Values found since the start.
    misses
        Values that had to be built.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.bytes = 0
        self.hits = 0
        self.misses = 0
        self._values: OrderedDict[Hashable, tuple[Any, int]] = OrderedDict()
        self._building: dict[Hashable, asyncio.Future[Any]] = {}
        self._lock = Lock()

    def __len__(self) -> int:
        """Count the values."""
        return len(self._values)

    def peek(self, key: Hashable) -> Any | None:
        """Return a value that is there, and count it as used.

        Parameters
        ----------
        key
            The value's.

        Returns
        -------
        Any or None
            None if it is not there.
        """
        with self._lock:
            if key not in self._values:
                return None
            self._values.move_to_end(key)
            self.hits += 1
            return self._values[key][0]

    async def get(self, key: Hashable, build: Callable[[], tuple[Any, int]]) -> Any:
        """Return a value, and build it if it is not there.

        Parameters
        ----------
        key
            The value's.
        build
            Returns the value and its size in bytes; called in a thread.

        Returns
        -------
        Any
            The value.

        Raises
        ------
        Exception
            What `build` raises, for all that want the value now; the next one builds it anew.
        """
        found = self.peek(key)
        if found is not None:
            return found
        if key not in self._building:
            self.misses += 1
            self._building[key] = asyncio.ensure_future(self._build(key, build))
        return await asyncio.shield(self._building[key])

    def forget(self, chosen: Callable[[Any], bool]) -> None:
        """Drop values; may be called in any thread.

        Parameters
        ----------
        chosen
            Tells by a value's key whether to drop it.
        """
        with self._lock:
            for key in [key for key in self._values if chosen(key)]:
                self.bytes -= self._values.pop(key)[1]

    async def _build(self, key: Hashable, build: Callable[[], tuple[Any, int]]) -> Any:
        try:
            value, size = await asyncio.to_thread(build)
        finally:
            del self._building[key]
        with self._lock:
            self._values[key] = (value, size)
            self.bytes += size
            while self.bytes > self.capacity and len(self._values) > 1:
                _, (_, freed) = self._values.popitem(last=False)
                self.bytes -= freed
        return value
