"""One request to an application in this process, and the body of its response."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any

import httpx
from starlette.types import ASGIApp, Message

_Head = tuple[int, list[tuple[bytes, bytes]]]
"""Status and headers of a response."""


class EmbeddedRequest:
    """One request through the application, between a client's thread and the event loop.

    Parameters
    ----------
    request
        Its body is read whole.

    Attributes
    ----------
    head
        Result: status and headers, once the application has sent them.
    chunks
        The body: bytes, then None at the end, or an exception where it broke off.
    """

    def __init__(self, request: httpx.Request) -> None:
        self.head: Future[_Head] = Future()
        self.chunks: SimpleQueue[bytes | Exception | None] = SimpleQueue()
        self._body = request.read()
        self._body_sent = False
        self._scope = _scope(request)

    async def run(self, app: ASGIApp) -> None:
        """Call the application; whatever happens, the client's thread is not left waiting.

        Parameters
        ----------
        app
            The application.
        """
        self._disconnected = asyncio.Event()
        reason = "the application ended without a whole response"
        try:
            await app(self._scope, self._receive, self._send)
        except BaseException as error:
            reason = str(error) or "the embedded service was closed before it answered"
            raise
        finally:  # after a whole response, this is not read any more
            broken_off = httpx.RemoteProtocolError(reason)
            self.chunks.put(broken_off)
            if not self.head.done():
                self.head.set_exception(broken_off)

    async def _receive(self) -> Message:
        if not self._body_sent:
            self._body_sent = True
            return {"type": "http.request", "body": self._body, "more_body": False}
        await self._disconnected.wait()
        return {"type": "http.disconnect"}

    async def _send(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.head.set_result((message["status"], list(message.get("headers", []))))
        elif message["type"] == "http.response.body":
            self.chunks.put(bytes(message.get("body", b"")))
            if not message.get("more_body", False):
                self.chunks.put(None)

    def disconnect(self) -> None:
        """Tell the application that the client does not read any further."""
        self._disconnected.set()


def _scope(request: httpx.Request) -> dict[str, Any]:
    """Return the ASGI scope of a request."""
    url = request.url
    return {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": request.method,
        "headers": [(name.lower(), value) for name, value in request.headers.raw],
        "scheme": url.scheme,
        "path": url.path,
        "raw_path": url.raw_path.split(b"?")[0],
        "query_string": url.query,
        "server": (url.host, url.port),
        "client": ("embedded", 0),
        "root_path": "",
    }


class ResponseBody(httpx.SyncByteStream):
    """The body of a response, read in the client's thread as the application sends it."""

    def __init__(self, sent: EmbeddedRequest, loop: asyncio.AbstractEventLoop) -> None:
        self._sent = sent
        self._loop = loop

    def __iter__(self) -> Iterator[bytes]:
        while (chunk := self._sent.chunks.get()) is not None:
            if isinstance(chunk, Exception):
                raise chunk
            yield chunk

    def close(self) -> None:
        if self._loop.is_running():
            self._loop.call_soon_threadsafe(self._sent.disconnect)
