"""A service in this process and a service of its own, over a small store with one run."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
from conftest import ACTION_NAMES, STATE_NAMES, drives
from ssil_service import embedded
from ssil_service.launching import Server, launched

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


@pytest.fixture(scope="session")
def asked(scored: Path) -> Iterator[httpx.Client]:
    """Plain requests to a service that all tests ask and none changes."""
    with embedded(scored, jobs=1) as store:
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


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Server]]:
    """Start services in processes of their own; all of them are ended with the test."""
    started: list[Server] = []

    def start(store: Path, *flags: str, keys: bool = False) -> Server:
        known = {"SSIL_READ_KEY": READ_KEY, "SSIL_WRITE_KEY": WRITE_KEY} if keys else {}
        log = tmp_path / f"log-{len(started)}"
        started.append(launched(store, *flags, log=log, environment=known))
        return started[-1]

    yield start
    for server in started:
        server.kill()
