"""A service in this process and a service of its own, over a small store with one run."""

import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import numpy as np
import pytest
from conftest import ACTION_NAMES, STATE_NAMES, drives
from ssil_service import embedded

import ssil_data as sd
from ssil_data.client import RemoteStore

READ_KEY, WRITE_KEY = "reads-and-asks-only", "writes-and-deletes-too"


@pytest.fixture(scope="session")
def scored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with a dataset `drives` and its run `vae`; copy it before writing."""
    folder = tmp_path_factory.mktemp("scored") / "store"
    dataset = sd.Store(folder).create(
        "drives", drives(), state_names=STATE_NAMES, action_names=ACTION_NAMES, card="# Drives"
    )
    sd.score(dataset, sd.VAE(steps=20), run="vae")
    return folder


@pytest.fixture
def folder(scored: Path, tmp_path: Path) -> Path:
    """A store of the test's own."""
    return Path(shutil.copytree(scored, tmp_path / "store"))


@pytest.fixture
def local(folder: Path) -> sd.Store:
    """The store on disk."""
    return sd.Store(folder)


@pytest.fixture
def remote(folder: Path) -> Iterator[RemoteStore]:
    """The same store through the service, in this process."""
    with embedded(folder, jobs=1) as store:
        yield store


@pytest.fixture
def http(remote: RemoteStore) -> httpx.Client:
    """Plain requests to the service in this process."""
    return remote.connection.client


@pytest.fixture
def states() -> np.ndarray:
    """Twenty states in raw units."""
    rng = np.random.default_rng(0)
    return rng.normal((10, 100, 0), size=(20, 3)).astype(np.float32)


@dataclass
class Server:
    """A service in a process of its own."""

    process: subprocess.Popen[bytes]
    url: str
    log: Path

    def kill(self) -> None:
        """End it at once, as a power cut would."""
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        """Ask it to end, and return its exit status."""
        self.process.terminate()
        return self.process.wait(60)


Serve = Callable[..., Server]


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Serve]:
    """Start services; all of them are ended with the test."""
    started: list[Server] = []

    def start(store: Path, *flags: str, keys: bool = False) -> Server:
        server = launched(store, tmp_path / f"log-{len(started)}", *flags, keys=keys)
        started.append(server)
        return server

    yield start
    for server in started:
        server.kill()


def launched(store: Path, log: Path, *flags: str, keys: bool = False) -> Server:
    """Start a service on a free port and wait until it is ready."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(log.parent)}
    if keys:
        environment |= {"SSIL_READ_KEY": READ_KEY, "SSIL_WRITE_KEY": WRITE_KEY}
    command = [str(Path(sys.executable).parent / "ssil-data"), "serve", "--store", str(store)]
    with log.open("wb") as errors:
        process = subprocess.Popen(
            [*command, "--port", str(port), *flags], env=environment, stderr=errors
        )
    server = Server(process, f"http://127.0.0.1:{port}", log)
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline and process.poll() is None:
        try:
            if httpx.get(f"{server.url}/readyz").status_code == 200:
                return server
        except httpx.TransportError:
            time.sleep(0.05)
    server.kill()
    raise RuntimeError(log.read_text())
