"""uvicorn's HTTP/1.1 protocol with a time limit for the head of a request, which it has not."""

from __future__ import annotations

import asyncio
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from ssil_service.problems import PROBLEM, Problem


def impatient(seconds: float) -> type[H11Protocol]:
    """Return a protocol that drops a connection whose next request's head takes longer."""

    class Impatient(H11Protocol):
        """Drops connections that say nothing, or half of something."""

        _deadline: asyncio.TimerHandle | None = None

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            self._wait()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            if self._answering():
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

        def connection_lost(self, exc: Exception | None) -> None:
            self._forget()
            super().connection_lost(exc)

        def _answering(self) -> bool:
            return self.cycle is not None and not self.cycle.response_complete

        def _wait(self) -> None:
            self._deadline = self.loop.call_later(seconds, self._drop)

        def _forget(self) -> None:
            if self._deadline is not None:
                self._deadline.cancel()
                self._deadline = None

        def _drop(self) -> None:
            self._deadline = None
            if not self._answering():
                self.transport.close()

    return Impatient
