"""Demonstrations for Pendulum that are made in a moment, and short settings to train on them."""

from __future__ import annotations

import numpy as np
import pytest

from ssil_data.demonstrations import Episode
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset


@pytest.fixture
def pendulum(store: Store, monkeypatch: pytest.MonkeyPatch) -> Dataset:
    """Random pairs for Pendulum: what is learned from them does not matter here."""
    rng = np.random.default_rng(0)
    episodes = [
        Episode(
            rng.normal(size=(40, 3)).astype(np.float32),
            rng.uniform(-2, 2, (40, 1)).astype(np.float32),
            labeled=number < 2,
        )
        for number in range(5)
    ]
    monkeypatch.setenv("SSIL_STORE", store.folder.uri)
    return store.create(
        "swings", episodes, state_names=["cos", "sin", "speed"], action_names=["torque"]
    )
