"""The service without a socket: the same client, the same application, one process."""

from __future__ import annotations

import asyncio
import atexit
from collections.abc import Coroutine, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any

import httpx
from starlette.types import ASGIApp, Message

from ssil_data.client import RemoteStore, ServiceError, connect
from ssil_service.app import create_app
from ssil_service.settings import read_settings

_NAME = "embedded"
"""The host that it is asked as: no browser can."""


def embed(store: str | Path = "datasets", **settings: Any) -> RemoteStore:
    """Return the store as a client sees it, served in this process; close it when done.

    `settings` are those of the service. Raises InvalidInputError for settings that are none.
    """
    app = create_app(read_settings(store=str(store), **settings), hosts=[_NAME])
    return connect(f"http://{_NAME}", transport=EmbeddedTransport(app))


class EmbeddedTransport(httpx.BaseTransport):
    """Calls an ASGI application on an event loop of its own thread; threads may share it."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._loop = asyncio.new_event_loop()
        self._threads = ThreadPoolExecutor(thread_name_prefix="embedded")
        self._loop.set_default_executor(self._threads)
        self._lock, self._closed = Lock(), False
        self._thread = Thread(target=self._loop.run_forever, daemon=True, name="embedded")
        self._thread.start()
        self._lifespan = _Lifespan(app)
        try:
            self._wait(self._lifespan.begin())
        except BaseException:
            self._stop()
            raise
        atexit.register(self.close)

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        """Answer a request; the body of the answer is read as the application sends it.

        Raises RemoteProtocolError if it is closed meanwhile, ServiceError if it was before.
        """
        exchange = _EmbeddedRequest(request)
        with self._lock:
            if self._closed:
                raise ServiceError("service: expected it open, found it closed")
            asyncio.run_coroutine_threadsafe(exchange.run(self.app), self._loop)
        status, headers = exchange.started.result()
        stream = _Body(exchange, self._loop)
        return httpx.Response(status, headers=headers, stream=stream, request=request)

    def close(self) -> None:
        """End the application's lifespan, what is still asked, and the thread."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        atexit.unregister(self.close)
        try:
            self._wait(self._lifespan.end())
        finally:
            self._wait(_cancel_all())
            self._stop()

    def _wait(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result()

    def _stop(self) -> None:
        self._threads.shutdown()  # before the loop, which is told what they do
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


async def _cancel_all() -> None:
    """End whatever the loop is still at: nobody may wait for it for ever."""
    left = asyncio.all_tasks() - {asyncio.current_task()}
    for task in left:
        task.cancel()
    await asyncio.gather(*left, return_exceptions=True)


class _Lifespan:
    """The application's start and stop."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def begin(self) -> None:
        """Start the application; raises what it raises."""
        self._stop = asyncio.Event()
        self._ready: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._startup_sent = False
        self._task = asyncio.ensure_future(
            self._app({"type": "lifespan"}, self._receive, self._send)
        )
        await asyncio.wait([self._task, self._ready], return_when=asyncio.FIRST_COMPLETED)
        if self._task.done():
            self._task.result()
        self._ready.result()

    async def end(self) -> None:
        """Stop the application."""
        self._stop.set()
        await self._task

    async def _receive(self) -> Message:
        if not self._startup_sent:
            self._startup_sent = True
            return {"type": "lifespan.startup"}
        await self._stop.wait()
        return {"type": "lifespan.shutdown"}

    async def _send(self, message: Message) -> None:
        if message["type"] == "lifespan.startup.complete":
            self._ready.set_result(None)


class _EmbeddedRequest:
    """One request through the application."""

    def __init__(self, request: httpx.Request) -> None:
        self.started: Future[tuple[int, list[tuple[bytes, bytes]]]] = Future()
        self.parts: SimpleQueue[bytes | Exception | None] = SimpleQueue()
        self._body = request.read()
        self._request_sent = False
        url = request.url
        self._scope: dict[str, Any] = {
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

    async def run(self, app: ASGIApp) -> None:
        """Run the application for this request."""
        self._left = asyncio.Event()
        found = "no end of the answer"
        try:
            await app(self._scope, self._receive, self._send)
        except BaseException as error:
            found = str(error) or "it closed meanwhile"
            raise
        finally:  # without effect after a whole answer
            cut = httpx.RemoteProtocolError(found)
            self.parts.put(cut)
            if not self.started.done():
                self.started.set_exception(cut)

    async def _receive(self) -> Message:
        if not self._request_sent:
            self._request_sent = True
            return {"type": "http.request", "body": self._body, "more_body": False}
        await self._left.wait()
        return {"type": "http.disconnect"}

    async def _send(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.started.set_result((message["status"], list(message.get("headers", []))))
        elif message["type"] == "http.response.body":
            self.parts.put(bytes(message.get("body", b"")))
            if not message.get("more_body", False):
                self.parts.put(None)

    def leave(self) -> None:
        """Tell the application that the client is gone."""
        self._left.set()


class _Body(httpx.SyncByteStream):
    """The body of an answer, part by part."""

    def __init__(self, exchange: _EmbeddedRequest, loop: asyncio.AbstractEventLoop) -> None:
        self._exchange, self._loop = exchange, loop

    def __iter__(self) -> Iterator[bytes]:
        while (part := self._exchange.parts.get()) is not None:
            if isinstance(part, Exception):
                raise part
            yield part

    def close(self) -> None:
        if self._loop.is_running():
            self._loop.call_soon_threadsafe(self._exchange.leave)
