"""A small table of training runs in Pendulum, on demonstrations that are made in a moment."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ssil_data.demonstrations import Episode
from ssil_data.store import Store
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.experiments.plan import Plan
from ssil_trainers.experiments.tables import Row, Table

SMALL = TrainSettings(
    environments=2, horizon=16, hidden=8, boundary=2, evaluations=1, cloning_steps=5
)
SWINGS = Table(
    name="swings",
    title="Table I: swings",
    dataset="swings",
    train_on="Pendulum-v1",
    tests=("Pendulum-v1", "Pendulum-v1?g=9.0"),
    labels=(40, 80),
    rows=(
        Row("gail", "GAIL"),
        Row("ssil", "SSIL (VAE)", "vae"),
        Row("constant", "constant", labeled=False),
        Row("clone", "clone"),
    ),
    budget=64,
    evaluate_every=1,
    full_score=-1000.0,
    episodes=2,
)


def create_swings(store: Store) -> None:
    """Make a dataset for Pendulum with every tier; what is learned from it does not matter."""
    rng = np.random.default_rng(0)
    tiers = ["expert", "expert", "0-25", "25-50", "50-75", "expert"]
    episodes = [
        Episode(
            rng.normal(0, 1 + (tier != "expert"), (40, 3)).astype(np.float32),
            rng.uniform(-2, 2, (40, 1)).astype(np.float32),
            labeled=number < 2,
            tier=tier,
        )
        for number, tier in enumerate(tiers)
    ]
    store.create("swings", episodes, state_names=["cos", "sin", "speed"], action_names=["torque"])


@pytest.fixture(scope="session")
def swings_plan() -> Callable[[Path], Plan]:
    """Return a function that makes a store and a plan of one seed, of which nothing is done."""

    def make_plan(folder: Path) -> Plan:
        store = Store(folder / "store")
        create_swings(store)
        return Plan(
            tables=(SWINGS,),
            leverage="swings",
            seeds=(0,),
            preset="default",
            training=SMALL,
            budget=None,
            source=store,
            output=folder / "out",
            work=folder / "out" / "work",
            estimators=("vae",),
        )

    return make_plan
