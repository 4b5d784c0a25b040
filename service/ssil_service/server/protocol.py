"""uvicorn's HTTP/1.1 protocol with limits that it has not.

A time for the head of a request, a number of connections, and an end to those whose client does
not read.
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


def timeout_protocol(*, head: float, send: float, connections: int) -> type[H11Protocol]:
    """Return a protocol that drops connections.

    Those whose next request's `head` takes more seconds, those that take nothing of an answer for
    `send` seconds, and of more than so many connections the newest, at once.
    """

    class TimeoutProtocol(H11Protocol):
        """Drops connections that say nothing, or half of something, or do not listen."""

        _deadline: asyncio.TimerHandle | None = None
        _deaf: asyncio.TimerHandle | None = None

        def connection_made(self, transport: Any) -> None:
            transport = CoalescingTransport(transport, self.loop)
            super().connection_made(transport)
            self.app_state = {**self.app_state, ABORT: transport.abort}
            if len(self.connections) > connections:
                transport.abort()
            else:
                self._wait()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            if self._is_answering():
                self._forget()
            elif self._deadline is None:
                self._wait()

        def send_400_response(self, msg: str) -> None:
            body = Problem(400, "request: expected HTTP/1.1, found bytes that are none").response()
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
            self._deaf = self.loop.call_later(send, self._give_up)

        def resume_writing(self) -> None:
            self._listens()
            super().resume_writing()

        def timeout_keep_alive_handler(self) -> None:
            self._end()

        def connection_lost(self, exc: Exception | None) -> None:
            self._forget()
            self._listens()
            super().connection_lost(exc)

        def _is_answering(self) -> bool:
            return self.cycle is not None and not self.cycle.response_complete

        def _wait(self) -> None:
            self._deadline = self.loop.call_later(head, self._drop)

        def _forget(self) -> None:
            if self._deadline is not None:
                self._deadline.cancel()
                self._deadline = None

        def _listens(self) -> None:
            if self._deaf is not None:
                self._deaf.cancel()
                self._deaf = None

        def _give_up(self) -> None:
            log_event("deaf", client=self.client)
            self.transport.abort()

        def _drop(self) -> None:
            self._deadline = None
            if not self._is_answering():
                self._end()

        def _end(self) -> None:
            """Close; what the client has not taken by now, it does not take."""
            if self.transport.get_write_buffer_size():
                self.transport.abort()
            else:
                self.transport.close()

    return TimeoutProtocol
