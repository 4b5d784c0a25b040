"""A service in a process of its own for a while: for tests, benchmarks and notebooks."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import httpx

_START_SECONDS = 30.0
_POLL_SECONDS = 0.02


@dataclass
class Server:
    """A service in a process of its own.

    Parameters
    ----------
    process
        The server's; its workers end with it.
    url
        Where it answers.
    """

    process: subprocess.Popen[bytes]
    url: str

    def kill(self) -> None:
        """Kill it, as a power cut would; its workers notice and end too."""
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        """Send SIGTERM, wait until it has finished what it accepted, return its exit status."""
        self.process.terminate()
        return self.process.wait()


def launch(
    store: str | Path,
    *flags: str,
    port: int | None = None,
    log: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> Server:
    """Run `ssil-data serve` in a process of its own and wait until it is ready.

    Parameters
    ----------
    store
        Folder or URI of the store.
    *flags
        Flags of `ssil-data serve`, such as `"--jobs", "1"`.
    port
        Where it listens on 127.0.0.1; a free port if None.
    log
        File for its log; None drops it.
    environment
        Variables beside those of this process.

    Returns
    -------
    Server
        To be stopped or killed by the caller.

    Raises
    ------
    RuntimeError
        If it is not ready within half a minute.
    """
    port = free_port() if port is None else port
    words = ["serve", "--store", str(store), "--port", str(port), *flags]
    command = [sys.executable, "-c", "from ssil_data.cli import main; main()", *words]
    with Path(log or os.devnull).open("wb") as log_file:
        variables = {**os.environ, **(environment or {})}
        process = subprocess.Popen(command, env=variables, stderr=log_file)
    server = Server(process, f"http://127.0.0.1:{port}")
    deadline = time.monotonic() + _START_SECONDS
    while time.monotonic() < deadline and process.poll() is None:
        try:
            if httpx.get(f"{server.url}/readyz").status_code == 200:
                return server
        except httpx.TransportError:
            time.sleep(_POLL_SECONDS)
    exit_status = process.poll()
    server.kill()
    log_text = Path(log).read_text() if log else "(no log was kept)"
    what = (
        f"was not ready within {_START_SECONDS:g} s"
        if exit_status is None
        else f"ended with exit status {exit_status}"
    )
    raise RuntimeError(f"The service {what}; its log:\n{log_text}")


def free_port() -> int:
    """Return a port of 127.0.0.1 on which no server listens now."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]
