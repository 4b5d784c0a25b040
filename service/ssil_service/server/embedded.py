"""The service without a socket: the same client and the same application, in this process."""

from __future__ import annotations

import asyncio
import atexit
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock, Thread
from typing import Any

import httpx
from starlette.types import ASGIApp, Message

from ssil_data.client import RemoteStore, ServiceError, connect
from ssil_service.app import create_app
from ssil_service.server.embedded_request import EmbeddedRequest, ResponseBody
from ssil_service.settings import read_settings

_HOST = "embedded"
"""The host name of its URLs, which no browser can reach."""


def embed(store: str | Path = "datasets", **settings: Any) -> RemoteStore:
    """Serve a store in this process, without a socket, and return it as a client sees it.

    The whole service runs, with its limits and its worker processes, on an event loop in a thread
    of its own. Close the store when done: that shuts the service down.

    Parameters
    ----------
    store
        Folder or URI of the store.
    **settings
        Settings of the service (`ssil_service.Settings`), such as `jobs=1`; what is not given
        comes from the environment.

    Returns
    -------
    RemoteStore
        The same object that `ssil_data.connect` returns for a URL; a context manager.

    Raises
    ------
    InvalidInputError
        If a setting has an invalid value.

    Examples
    --------
    >>> from ssil_service import embed
    >>> with embed(store.folder.uri, jobs=1) as served:
    ...     field = served["drives"].field("vae")
    ...     lcor = field.lcor(np.array([[10.0, 100.0, 0.0]])).values
    >>> lcor.shape
    (1,)
    """
    app = create_app(read_settings(store=str(store), **settings), hosts=[_HOST])
    return connect(f"http://{_HOST}", transport=EmbeddedTransport(app))


class EmbeddedTransport(httpx.BaseTransport):
    """Sends the requests of an `httpx.Client` to an ASGI application in this process.

    The application runs on an event loop of its own thread, from construction until `close`;
    any number of threads may send requests. It is closed at the end of the process at the latest.

    Parameters
    ----------
    app
        The application; its lifespan has begun when the constructor returns.

    Raises
    ------
    Exception
        What the application raises when it starts.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._loop = asyncio.new_event_loop()
        self._threads = ThreadPoolExecutor(thread_name_prefix="embedded")
        self._loop.set_default_executor(self._threads)
        self._lock = Lock()
        self._closed = False
        self._thread = Thread(target=self._loop.run_forever, daemon=True, name="embedded")
        self._thread.start()
        self._lifespan = _Lifespan(app)
        try:
            self._wait(self._lifespan.start())
        except BaseException:
            self._stop_loop()
            raise
        atexit.register(self.close)

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        """Send a request and wait for the head of the response.

        Parameters
        ----------
        request
            Its body is read whole.

        Returns
        -------
        httpx.Response
            Its body is read as the application sends it.

        Raises
        ------
        RemoteProtocolError
            If the application ends without a response, or the transport is closed meanwhile.
        ServiceError
            If the transport was closed before.
        """
        sent = EmbeddedRequest(request)
        with self._lock:
            if self._closed:
                raise ServiceError("The embedded service is closed; call embed() again")
            asyncio.run_coroutine_threadsafe(sent.run(self.app), self._loop)
        status, headers = sent.head.result()
        body = ResponseBody(sent, self._loop)
        return httpx.Response(status, headers=headers, stream=body, request=request)

    def close(self) -> None:
        """Shut the application down, cancel what still runs, and end the thread."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        atexit.unregister(self.close)
        try:
            self._wait(self._lifespan.stop())
        finally:
            self._wait(_cancel_all())
            self._stop_loop()

    @property
    def running(self) -> bool:
        """Whether the event loop and its thread still exist."""
        return self._thread.is_alive() or not self._loop.is_closed()

    def _wait(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result()

    def _stop_loop(self) -> None:
        self._threads.shutdown()  # before the loop, which their results are sent to
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


async def _cancel_all() -> None:
    """Cancel all other tasks of the loop, so that no thread is left waiting for them."""
    tasks = asyncio.all_tasks() - {asyncio.current_task()}
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


class _Lifespan:
    """Starts and stops an application by ASGI's lifespan messages."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def start(self) -> None:
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

    async def stop(self) -> None:
        """Stop the application; raises what it raises."""
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
