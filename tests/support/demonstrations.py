"""Small demonstrations made here, and where the real ones are."""

from pathlib import Path

import numpy as np

from ssil_data.demonstrations import Episode

ROOT = Path(__file__).parents[2]
"""The checkout."""
DATASETS = ROOT / "datasets"
"""The committed store."""
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
