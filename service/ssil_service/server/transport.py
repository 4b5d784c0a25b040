"""A connection's transport that sends at once what is written in one round of the event loop.

uvicorn writes the head of an answer and its body separately: two system calls, each of which
wakes the client.
"""

from __future__ import annotations

import asyncio

_COALESCED_BYTES = 65_536
"""Most bytes that are collected; more are sent at once."""


class CoalescingTransport:
    """The part of `asyncio.Transport` that uvicorn uses, with writes collected.

    Parameters
    ----------
    transport
        The connection's.
    loop
        The event loop that it runs in.
    """

    def __init__(self, transport: asyncio.Transport, loop: asyncio.AbstractEventLoop) -> None:
        self._transport = transport
        self._loop = loop
        self._chunks: list[bytes] = []
        self._size = 0
        self.get_extra_info = transport.get_extra_info
        self.is_closing = transport.is_closing
        self.pause_reading = transport.pause_reading
        self.resume_reading = transport.resume_reading

    def write(self, data: bytes) -> None:
        """Send bytes, at the latest in the loop's next round.

        Parameters
        ----------
        data
            Part of an answer.
        """
        if not data:
            return
        if not self._chunks:
            self._loop.call_soon(self._flush)
        self._chunks.append(data)
        self._size += len(data)
        if self._size > _COALESCED_BYTES:
            self._flush()

    def get_write_buffer_size(self) -> int:
        """Count the bytes that are not sent yet."""
        return self._transport.get_write_buffer_size() + self._size

    def close(self) -> None:
        """Send what was written, and close."""
        self._flush()
        self._transport.close()

    def abort(self) -> None:
        """Close at once, and drop what was written."""
        self._chunks = []
        self._size = 0
        self._transport.abort()

    def _flush(self) -> None:
        if self._chunks:
            data = b"".join(self._chunks)
            self._chunks = []
            self._size = 0
            self._transport.write(data)
