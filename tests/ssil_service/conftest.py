"""A service in this process and a service of its own, over a small store with one run."""

import shutil
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

import ssil_data as sd
from ssil_data.client import RemoteStore
from ssil_service import embed
from ssil_service.server.launch import Server, launch
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drives

READ_KEY = "reads-and-asks-only"
WRITE_KEY = "writes-and-deletes-too"


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
    """A store of the test's own, without what services left in the one that is copied."""
    ignored = shutil.ignore_patterns(".service")
    return Path(shutil.copytree(scored, tmp_path / "store", ignore=ignored))


@pytest.fixture
def local(folder: Path) -> sd.Store:
    """The store on disk."""
    return sd.Store(folder)


@pytest.fixture
def remote(folder: Path) -> Iterator[RemoteStore]:
    """The same store through the service, in this process."""
    with embed(folder, jobs=1) as store:
        yield store


@pytest.fixture(scope="session")
def shared_http(scored: Path) -> Iterator[httpx.Client]:
    """Plain requests to a service that all tests share and none changes."""
    with embed(scored, jobs=1) as store:
        yield store.connection.client


@pytest.fixture
def http(remote: RemoteStore) -> httpx.Client:
    """Plain requests to the service in this process."""
    return remote.connection.client


@pytest.fixture
def states() -> np.ndarray:
    """Twenty states in raw units."""
    rng = np.random.default_rng(0)
    return rng.normal((10, 100, 0), size=(20, 3)).astype(np.float32)


@pytest.fixture(scope="session")
def served_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the server below: its store and its log."""
    return tmp_path_factory.mktemp("server")


@pytest.fixture(scope="session")
def server(scored: Path, served_folder: Path) -> Iterator[Server]:
    """A service with short time-outs, over a store with a dataset `many` of 400,000 pairs."""
    store = sd.Store(shutil.copytree(scored, served_folder / "store"))
    rng = np.random.default_rng(0)
    many = sd.Episode(rng.normal(size=(400_000, 3)), rng.normal(size=(400_000, 2)))
    store.create("many", [many], state_names=STATE_NAMES, action_names=ACTION_NAMES)
    flags = ("--header-seconds", "1", "--body-seconds", "1", "--send-seconds", "1")
    limits = ("--grace-seconds", "5", "--connections", "60", "--page-rows", "400000")
    server = launch(served_folder / "store", *flags, *limits, log=served_folder / "log")
    yield server
    assert server.stop() == 0


@pytest.fixture
def raw(server: Server) -> Iterator[Callable[..., socket.socket]]:
    """Connect to that service and send raw bytes."""
    opened: list[socket.socket] = []

    def connect(data: bytes = b"", *, buffer: int = 0) -> socket.socket:
        host, port = server.url.removeprefix("http://").split(":")
        connection = socket.socket()
        opened.append(connection)
        if buffer:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
        connection.settimeout(20)
        connection.connect((host, int(port)))
        connection.sendall(data)
        return connection

    yield connect
    for connection in opened:
        connection.close()


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Server]]:
    """Start services in processes of their own; all of them are killed at the end of the test."""
    started: list[Server] = []

    def start(store: Path, *flags: str, keys: bool = False) -> Server:
        variables = {"SSIL_READ_KEY": READ_KEY, "SSIL_WRITE_KEY": WRITE_KEY} if keys else {}
        log = tmp_path / f"log-{len(started)}"
        started.append(launch(store, *flags, log=log, environment=variables))
        return started[-1]

    yield start
    for server in started:
        server.kill()
