"""The command `ssil-data serve`: settings, logs, a socket, and an orderly end."""

from __future__ import annotations

import signal
import socket
from pathlib import Path
from tempfile import TemporaryFile
from types import FrameType
from typing import Annotated

import uvicorn
from cyclopts import Parameter

from ssil_data.errors import InvalidInputError
from ssil_service.http.middleware import Middleware
from ssil_service.logs import start_logging
from ssil_service.security.authentication import refuse_open_doors
from ssil_service.server.protocol import timeout_protocol
from ssil_service.settings import Settings, read_settings


def serve(*, settings: Annotated[Settings | None, Parameter(name="*")] = None) -> int:
    """Serve leverage and LCoR over REST, on the store.

    Every flag is also an environment variable: --port is SSIL_PORT. Keys are read from
    SSIL_READ_KEY and SSIL_WRITE_KEY only.
    """
    settings = settings or read_settings()
    refuse_open_doors(settings)
    _refuse_no_place(settings.state_folder)
    _refuse_taken_port(settings.host, settings.port)
    from ssil_service.app import create_app  # only now: a refusal waits for no torch

    start_logging(settings.log_level)
    # uvicorn ends in order, and then raises the signal again: by then it means nothing
    signal.signal(signal.SIGTERM, lambda number, frame: None)
    server = _Server(create_app(settings), settings)
    server.run()
    return 0 if server.started else 2


def _refuse_no_place(folder: Path) -> None:
    """Raise InvalidInputError if the state cannot be kept in a folder."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InvalidInputError(
            f"state: expected a folder to write to, found {folder}: {error.strerror}"
        ) from None


def _refuse_taken_port(host: str, port: int) -> None:
    """Raise InvalidInputError if nobody can listen there."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, kind, protocol, _, address in found:
            with socket.socket(family, kind, protocol) as tried:
                tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                if family == socket.AF_INET6:
                    tried.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
                tried.bind(address)
    except OSError as error:
        raise InvalidInputError(
            f"port: expected a free one of this machine, found {host} {port}: {error.strerror}"
        ) from None


class _Server(uvicorn.Server):
    """uvicorn, which tells the service as soon as it is asked to end."""

    def __init__(self, app: Middleware, settings: Settings) -> None:
        self._app = app
        config = uvicorn.Config(
            app,
            host=settings.host,
            port=settings.port,
            http=timeout_protocol(
                head=settings.header_seconds,
                send=settings.send_seconds,
                connections=settings.connections,
            ),
            ws="none",
            lifespan="on",
            log_config=None,
            access_log=False,
            server_header=False,
            timeout_keep_alive=30,
            timeout_graceful_shutdown=int(settings.grace_seconds) or 1,
        )
        super().__init__(config)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to end: event streams stop, `/readyz` says so."""
        self._app.begin_shutdown()
        super().handle_exit(sig, frame)
