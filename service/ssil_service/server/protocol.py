"""uvicorn's HTTP/1.1 protocol with limits that it lacks.

A time-out for the head of a request, a number of connections, and a time-out for clients that do
not read their answer. These protect a service that is reachable without a proxy.
"""

from __future__ import annotations

import asyncio
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from ssil_service.http.limits import ABORT
from ssil_service.logs import log_event
from ssil_service.problems import PROBLEM, Problem
from ssil_service.server.transport import CoalescingTransport


def timeout_protocol(
    *, header_seconds: float, send_seconds: float, connection_limit: int
) -> type[H11Protocol]:
    """Make a protocol that closes connections which take too long.

    Parameters
    ----------
    header_seconds
        Time for the head of a request to arrive, from the opening of the connection or the end of
        the answer before.
    send_seconds
        Time in which a client must read something of an answer that is ready.
    connection_limit
        Most connections; further ones are closed at once.

    Returns
    -------
    type
        For `uvicorn.Config(http=…)`.
    """

    class TimeoutProtocol(H11Protocol):
        """Closes connections whose client sends or reads nothing for too long.

        Two timers per connection: `_header_timeout` runs while a request is awaited,
        `_write_timeout` while the operating system's buffer is full.
        """

        _header_timeout: asyncio.TimerHandle | None = None
        _write_timeout: asyncio.TimerHandle | None = None

        def connection_made(self, transport: Any) -> None:
            transport = CoalescingTransport(transport, self.loop)
            super().connection_made(transport)
            self.app_state = {**self.app_state, ABORT: transport.abort}
            if len(self.connections) > connection_limit:
                transport.abort()
            else:
                self._start_header_timeout()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            if self._is_answering():
                self._stop_header_timeout()
            elif self._header_timeout is None:
                self._start_header_timeout()

        def send_400_response(self, msg: str) -> None:
            body = Problem(400, "Request: not valid HTTP/1.1").response()
            headers = [(b"content-type", PROBLEM.encode()), (b"connection", b"close")]
            events = (
                h11.Response(status_code=400, headers=headers, reason=b"Bad Request"),
                h11.Data(data=bytes(body.body)),
                h11.EndOfMessage(),
            )
            for event in events:
                self.transport.write(self.conn.send(event) or b"")
            self.transport.close()

        def pause_writing(self) -> None:
            super().pause_writing()
            self._write_timeout = self.loop.call_later(send_seconds, self._drop_slow_reader)

        def resume_writing(self) -> None:
            self._stop_write_timeout()
            super().resume_writing()

        def timeout_keep_alive_handler(self) -> None:
            self._close()

        def connection_lost(self, exc: Exception | None) -> None:
            self._stop_header_timeout()
            self._stop_write_timeout()
            super().connection_lost(exc)

        def _is_answering(self) -> bool:
            return self.cycle is not None and not self.cycle.response_complete

        def _start_header_timeout(self) -> None:
            self._header_timeout = self.loop.call_later(header_seconds, self._drop_slow_sender)

        def _stop_header_timeout(self) -> None:
            if self._header_timeout is not None:
                self._header_timeout.cancel()
                self._header_timeout = None

        def _stop_write_timeout(self) -> None:
            if self._write_timeout is not None:
                self._write_timeout.cancel()
                self._write_timeout = None

        def _drop_slow_reader(self) -> None:
            log_event("client does not read", client=self.client)
            self.transport.abort()

        def _drop_slow_sender(self) -> None:
            self._header_timeout = None
            if not self._is_answering():
                self._close()

        def _close(self) -> None:
            """Close, without waiting for a client that has not read the answer before."""
            if self.transport.get_write_buffer_size():
                self.transport.abort()
            else:
                self.transport.close()

    return TimeoutProtocol
