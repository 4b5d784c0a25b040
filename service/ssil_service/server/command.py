"""The command `ssil-data serve`: settings, logs, a socket, and an orderly shutdown."""

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
from ssil_service.security.authentication import refuse_open_access
from ssil_service.server.protocol import timeout_protocol
from ssil_service.settings import Settings, read_settings

_KEEP_ALIVE_SECONDS = 30


def serve(*, settings: Annotated[Settings | None, Parameter(name="*")] = None) -> int:
    """Serve leverage and LCoR over REST, on the store.

    Every flag is also an environment variable: --port is SSIL_PORT. Keys are read from
    SSIL_READ_KEY and SSIL_WRITE_KEY only.
    """
    settings = settings or read_settings()
    refuse_open_access(settings)
    _refuse_unwritable(settings.state_folder)
    _refuse_used_port(settings.host, settings.port)
    from ssil_service.app import create_app  # imports torch, for which no refusal should wait

    start_logging(settings.log_level)
    # uvicorn shuts down in order and then raises the signal again, which must not end the process
    signal.signal(signal.SIGTERM, lambda number, frame: None)
    server = _Server(create_app(settings), settings)
    server.run()
    return 0 if server.started else 2


def _refuse_unwritable(folder: Path) -> None:
    """Raise InvalidInputError if the service cannot write to its state folder."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InvalidInputError(
            f"state: cannot write to {folder} ({error.strerror}); choose another folder (--state)"
        ) from None


def _refuse_used_port(host: str, port: int) -> None:
    """Raise InvalidInputError if no server can listen on a port of this machine."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        for family, kind, protocol, _, address in found:
            with socket.socket(family, kind, protocol) as listener:
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                if family == socket.AF_INET6:
                    listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
                listener.bind(address)
    except OSError as error:
        raise InvalidInputError(
            f"port: cannot listen on {host} port {port} ({error.strerror}); "
            "choose another --port or --host"
        ) from None


class _Server(uvicorn.Server):
    """uvicorn, which starts the time of grace as soon as it gets a signal to end."""

    def __init__(self, app: Middleware, settings: Settings) -> None:
        self._app = app
        config = uvicorn.Config(
            app,
            host=settings.host,
            port=settings.port,
            http=timeout_protocol(
                header_seconds=settings.header_seconds,
                send_seconds=settings.send_seconds,
                connection_limit=settings.connections,
            ),
            ws="none",
            lifespan="on",
            log_config=None,
            access_log=False,
            server_header=False,
            timeout_keep_alive=_KEEP_ALIVE_SECONDS,
            timeout_graceful_shutdown=int(settings.grace_seconds) or 1,
        )
        super().__init__(config)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to shut down: event streams end, `/readyz` answers 503."""
        self._app.begin_shutdown()
        super().handle_exit(sig, frame)
