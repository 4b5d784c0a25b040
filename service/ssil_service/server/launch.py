"""A service in a process of its own, for whoever needs one for a while: tests, benchmarks."""

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

_PATIENCE = 30.0


@dataclass
class Server:
    """A service in a process of its own."""

    process: subprocess.Popen[bytes]
    url: str

    def kill(self) -> None:
        """End it at once, as a power cut would; its workers notice and end too."""
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        """Ask it to end, wait until it has finished what it accepted, return its exit status."""
        self.process.terminate()
        return self.process.wait()


def launch(
    store: str | Path,
    *flags: str,
    port: int | None = None,
    log: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> Server:
    """Run `ssil-data serve` on a port, a free one unless given, and wait until it is ready.

    Raises RuntimeError if it is not within half a minute.
    """
    port = free_port() if port is None else port
    words = ["serve", "--store", str(store), "--port", str(port), *flags]
    command = [sys.executable, "-c", "from ssil_data.cli import main; main()", *words]
    with Path(log or os.devnull).open("wb") as errors:
        known = {**os.environ, **(environment or {})}
        process = subprocess.Popen(command, env=known, stderr=errors)
    server = Server(process, f"http://127.0.0.1:{port}")
    deadline = time.monotonic() + _PATIENCE
    while time.monotonic() < deadline and process.poll() is None:
        try:
            if httpx.get(f"{server.url}/readyz").status_code == 200:
                return server
        except httpx.TransportError:
            time.sleep(0.02)
    ended = process.poll()
    server.kill()
    raise RuntimeError(
        f"service: expected it ready within {_PATIENCE:g} s, found it not "
        f"(status {ended}); {Path(log).read_text() if log else 'no log'}"
    )


def free_port() -> int:
    """Return a port that nobody listens on now."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]
