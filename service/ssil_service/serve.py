"""The command `ssil-data serve`: settings, logs, a socket, and an orderly end."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Annotated

import uvicorn
from cyclopts import Parameter

from ssil_service.edge import Edge
from ssil_service.keys import refuse_open_doors
from ssil_service.logs import start_logging
from ssil_service.protocol import impatient
from ssil_service.settings import Settings, read_settings


def serve(*, settings: Annotated[Settings | None, Parameter(name="*")] = None) -> int:
    """Serve leverage and LCoR over REST, on the store.

    Every flag is also an environment variable: --port is SSIL_PORT. Keys are read from
    SSIL_READ_KEY and SSIL_WRITE_KEY only.
    """
    settings = settings or read_settings()
    refuse_open_doors(settings)
    _ = settings.state_folder
    from ssil_service.app import create_app  # only now: a refusal waits for no torch

    start_logging(settings.log_level)
    # uvicorn ends in order, and then raises the signal again: by then it means nothing
    signal.signal(signal.SIGTERM, lambda number, frame: None)
    server = _Server(create_app(settings), settings)
    server.run()
    return 0 if server.started else 2


class _Server(uvicorn.Server):
    """uvicorn, which tells the service as soon as it is asked to end."""

    def __init__(self, app: Edge, settings: Settings) -> None:
        self._edge = app
        config = uvicorn.Config(
            app,
            host=settings.host,
            port=settings.port,
            http=impatient(
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
        self._edge.leave()
        super().handle_exit(sig, frame)
