"""How many environment steps per second does training make, evaluation included?

Rows train in turns with each other on the racetrack's twin, 32 cars × 64 steps an iteration, torch
in one thread. stable-baselines3-contrib's TRPO gets the true reward, and has no discriminator, no
second critic and no evaluation: with our settings on the same twin; with its own defaults there,
2,048 steps of each car and ten epochs of its critic in batches of 128; and with its own defaults on
one real environment, as it is usually called. Processor time is what one core would take, wall time
what the machine took, with whatever else it was doing. Then where an iteration's time goes.
"""

from __future__ import annotations

import os

os.environ |= {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}  # before NumPy and numba load

import cProfile
import pstats
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from sb3_contrib import TRPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

import ssil_data as sd
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.envs.registry import make_single, make_vectorized
from ssil_trainers.envs.sb3_vec_env import StableBaselinesVecEnv
from ssil_trainers.training.data import TrainingData
from ssil_trainers.training.run import TrainResult, train

ROUNDS = 3
STEPS = 65_536
REAL_STEPS = 4_096
OURS = TrainSettings()
LIKE_OURS = {
    "n_steps": OURS.horizon,
    "batch_size": OURS.critic_batch,
    "n_critic_updates": OURS.critic_epochs,
    "learning_rate": OURS.critic_rate,
    "cg_max_steps": OURS.conjugate_steps,
    "sub_sampling_factor": round(1 / OURS.fisher_share),
    "gamma": OURS.discount,
    "gae_lambda": OURS.gae_lambda,
    "target_kl": OURS.kl,
    "policy_kwargs": {"net_arch": {"pi": [OURS.hidden] * 2, "vf": [OURS.hidden] * 2}},
}


def train_on_racetrack(dataset: sd.Dataset, method: str, settings: TrainSettings) -> TrainResult:
    """Train by a method on the racetrack; leaves no files."""
    run = "windowvae" if METHODS[method].uses_run else None
    data = TrainingData.read(dataset, run)
    return train(method, data, partial(make_vectorized, "racetrack"), settings=settings)


def rival(envs: VecEnv, steps: int, settings: Mapping[str, Any]) -> None:
    """Train sb3-contrib's TRPO by the true reward."""
    TRPO("MlpPolicy", envs, seed=0, device="cpu", **settings).learn(steps)


def twin() -> VecEnv:
    """Return 32 cars of the twin."""
    return StableBaselinesVecEnv(make_vectorized("racetrack", 32))


def real() -> VecEnv:
    """Return one real environment, as sb3 wraps it."""
    return DummyVecEnv([partial(make_single, "racetrack")])


@dataclass(frozen=True)
class Row:
    """One row of the comparison: a training loop, called with a number of steps."""

    name: str
    train: Callable[[int], object]
    steps: int = STEPS


def rows(dataset: sd.Dataset) -> list[Row]:
    """Return what is compared."""

    def ours(method: str, **settings: Any) -> Callable[[int], object]:
        return lambda steps: train_on_racetrack(
            dataset, method, replace(OURS, steps=steps, **settings)
        )

    return [
        Row("GAIL", ours("gail")),
        Row("GAIL, evaluated at its ends alone", ours("gail", evaluate_every=10_000)),
        Row("MixGAIL", ours("mixgail")),
        Row(f"SSIL, {len(dataset):,} demonstrations", ours("ssil")),
        Row("SSIL with the windowVAE's pair reward", ours("ssil", pair_reward=1.0)),
        Row("sb3-contrib TRPO, our settings", lambda steps: rival(twin(), steps, LIKE_OURS)),
        Row("its defaults", lambda steps: rival(twin(), steps, {})),
        Row("its defaults, one real car", lambda steps: rival(real(), steps, {}), REAL_STEPS),
    ]


def print_speeds(compared: list[Row]) -> None:
    """Print steps a second, medians over interleaved rounds, and how many times that GAIL makes."""
    found: dict[str, list[tuple[float, float]]] = {row.name: [] for row in compared}
    for row in compared:
        row.train(2_048)
    for _ in range(ROUNDS):
        for row in compared:
            wall = time.perf_counter()
            processor = time.process_time()
            row.train(row.steps)
            processor_seconds = time.process_time() - processor
            wall_seconds = time.perf_counter() - wall
            found[row.name].append((row.steps / processor_seconds, row.steps / wall_seconds))
    median = {
        name: [statistics.median(column) for column in zip(*rates, strict=True)]
        for name, rates in found.items()
    }
    gail, *_ = median.values()
    print(f"{STEPS:,} steps, medians of {ROUNDS} interleaved rounds, steps/s (GAIL's / the row's)")
    print(f"{'':>38}{'processor time':>22}{'wall time':>22}")
    for name, rates in median.items():
        cells = (f"{r:,.0f} ({g / r:.2f})" for r, g in zip(rates, gail, strict=True))
        print(f"{name:>38}" + "".join(f"{cell:>22}" for cell in cells))


def print_shares(dataset: sd.Dataset) -> None:
    """Print how GAIL's time is shared out among its parts."""
    profile = cProfile.Profile()
    profile.runcall(train_on_racetrack, dataset, "gail", TrainSettings(steps=STEPS))
    stats = pstats.Stats(profile).stats  # pyright: ignore[reportAttributeAccessIssue]
    whole = max(figures[3] for figures in stats.values())
    names = {
        ("rollout.py", "collect"): "driving",
        ("run.py", "_evaluate"): "evaluation",
        ("discriminator.py", "__call__"): "discriminator",
        ("trpo.py", "step"): "policy step",
        ("learner.py", "_fit_critics"): "critics",
    }
    missing = set(names) - {(Path(place).name, function) for place, _, function in stats}
    assert not missing, f"functions that were renamed: {missing}"
    shares = {
        names[Path(place).name, function]: figures[3] / whole
        for (place, _, function), figures in stats.items()
        if (Path(place).name, function) in names
    }
    print("GAIL: " + ", ".join(f"{name} {share:.0%}" for name, share in shares.items()))


def main() -> None:
    """Score a copy of the racetrack demonstrations and run everything."""
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        source = Path(__file__).parents[1] / "datasets" / "racetrack"
        shutil.copytree(source, Path(folder) / "racetrack")
        dataset = sd.Store(folder)["racetrack"]
        if "windowvae" not in dataset.runs.names():
            sd.score(dataset, sd.WindowVAE(), run="windowvae", seed=0)
        print_speeds(rows(dataset))
        print_shares(dataset)


if __name__ == "__main__":
    main()
