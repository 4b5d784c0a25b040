"""A connection's transport that sends at once what is written in one round of the loop.

uvicorn writes the head of an answer and its body apart: two calls of the system, each of which
wakes the client.
"""

from __future__ import annotations

import asyncio

_MOST = 65_536
"""Bytes that wait for more at most."""


class CoalescingTransport:
    """What uvicorn uses of a transport."""

    def __init__(self, transport: asyncio.Transport, loop: asyncio.AbstractEventLoop) -> None:
        self._transport, self._loop = transport, loop
        self._parts: list[bytes] = []
        self._size = 0
        self.get_extra_info = transport.get_extra_info
        self.is_closing = transport.is_closing
        self.pause_reading = transport.pause_reading
        self.resume_reading = transport.resume_reading

    def write(self, data: bytes) -> None:
        """Send, before the loop's next round."""
        if not data:
            return
        if not self._parts:
            self._loop.call_soon(self._leave)
        self._parts.append(data)
        self._size += len(data)
        if self._size > _MOST:
            self._leave()

    def get_write_buffer_size(self) -> int:
        """Count the bytes that are not sent yet."""
        return self._transport.get_write_buffer_size() + self._size

    def close(self) -> None:
        """Send what was written, and close."""
        self._leave()
        self._transport.close()

    def abort(self) -> None:
        """Close at once."""
        self._parts, self._size = [], 0
        self._transport.abort()

    def _leave(self) -> None:
        if self._parts:
            data = b"".join(self._parts)
            self._parts, self._size = [], 0
            self._transport.write(data)
