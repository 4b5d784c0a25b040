"""Demonstrations for every test: small ones made here, real ones where they are present."""

import os
from pathlib import Path

import numpy as np
import pytest

from ssil_data.demonstrations import Episode
from ssil_data.store import Store

SHARED_DATA = Path(
    os.environ.get("SSIL_TEST_DATA") or Path(__file__).parents[2] / "shared" / "data"
)
STATE_NAMES = ("distance", "speed", "heading")
ACTION_NAMES = ("throttle", "steering")


def drive(seed: int, length: int, *, spread: float = 1.0, **known: object) -> Episode:
    """A smooth random drive; a larger spread is a worse one."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(size=(length, 3)), axis=0) / np.sqrt(length)
    states = (walk * spread + [10.0, 100.0, 0.0]).astype(np.float32)
    actions = np.tanh(walk[:, :2] + rng.normal(size=(length, 2)) * 0.1).astype(np.float32)
    return Episode(states, actions, **known)  # pyright: ignore[reportArgumentType]


def drives() -> list[Episode]:
    """Two labeled drives, three more by the expert, and six of two worse tiers."""
    labeled = [drive(seed, 60, labeled=True, tier="expert", score=1.0) for seed in range(2)]
    expert = [drive(10 + seed, 50, tier="expert", score=1.0 - seed / 100) for seed in range(3)]
    fair = [drive(20 + s, 30, spread=4, tier="50-75", score=0.6 - s / 100) for s in range(3)]
    poor = [drive(30 + s, 20, spread=16, tier="0-25", score=0.2 - s / 100) for s in range(3)]
    return [*labeled, *expert, *fair, *poor]


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
