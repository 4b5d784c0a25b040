"""Fixtures for every test: small datasets made here, real demonstrations where they are present."""

import gc
import os
from pathlib import Path

import pytest

from ssil_data.store import Store
from support.demonstrations import ACTION_NAMES, ROOT, STATE_NAMES, drives

SHARED_DATA = Path(os.environ.get("SSIL_TEST_DATA") or ROOT.parent / "shared" / "data")


def pytest_collection_finish() -> None:
    """Spare the garbage collector what collection made: it would look through it all day."""
    gc.collect()
    gc.freeze()


def pytest_sessionfinish() -> None:
    """Let it see all again, as libraries count what was left when the process ends."""
    gc.unfreeze()


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """An empty store."""
    return Store(tmp_path / "store")


@pytest.fixture
def dataset(store: Store):
    """A small dataset of eleven drives."""
    return store.create(
        "drives", drives(), state_names=STATE_NAMES, action_names=ACTION_NAMES, card="# Drives"
    )


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real demonstrations that nobody in the project made; the test is skipped without them."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"the real demonstrations are not at {SHARED_DATA}")
    return SHARED_DATA
