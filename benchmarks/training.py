"""How many environment steps a second does training make, evaluation included?

Rows train in turns with each other on the racetrack's twin, 32 cars × 64 steps an iteration, torch
in one thread. stable-baselines3-contrib's TRPO gets the true reward, on real environments as it
usually takes them and on the same twin: it has no discriminator, no second critic, no evaluation.
Processor time is what one core would take, wall time what the machine took, with whatever else it
was doing. Then where an iteration's time goes.
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
from collections.abc import Callable
from functools import partial
from pathlib import Path

import torch
from sb3_contrib import TRPO
from ssil_trainers.labels import expert_return
from ssil_trainers.methods import METHODS, Demonstrations
from ssil_trainers.settings import TrainSettings
from ssil_trainers.stable_baselines import StableBaselinesVecEnv
from ssil_trainers.tasks import side_by_side, single
from ssil_trainers.training import Job, train
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

import ssil_data as sd

ROUNDS = 3
STEPS = 61_440


def job(dataset: sd.Dataset, method: str, settings: TrainSettings) -> Job:
    """Return a run of a method on the racetrack, which leaves no files."""
    run = "windowvae" if METHODS[method].takes_run else None
    pairs = dataset.pairs()
    demonstrations = Demonstrations(
        pairs.states,
        pairs.actions,
        dataset.per_pair("labeled").astype(bool),
        dataset.leverage(run) if run else None,
        dataset.field(run) if run else None,
    )
    expert = expert_return(dataset)
    return Job(method, settings, demonstrations, lambda n: side_by_side("racetrack", n), {}, expert)


def rival(envs: VecEnv, steps: int) -> None:
    """Train sb3-contrib's TRPO by the true reward."""
    learner = TRPO(
        "MlpPolicy",
        envs,
        n_steps=64,
        batch_size=256,
        seed=0,
        device="cpu",
        policy_kwargs={"net_arch": {"pi": [64, 64], "vf": [64, 64]}},
    )
    learner.learn(steps)


def twin() -> VecEnv:
    """Return 32 cars of the twin."""
    return StableBaselinesVecEnv(side_by_side("racetrack", 32))


def real() -> VecEnv:
    """Return 32 real environments, stepped one by one as is usual."""
    return DummyVecEnv([partial(single, "racetrack")] * 32)


def rows(dataset: sd.Dataset) -> dict[str, Callable[[int], object]]:
    """Return what is compared: each takes a number of steps."""

    def ours(method: str, evaluate_every: int = 5) -> Callable[[int], object]:
        return lambda steps: train(
            job(dataset, method, TrainSettings(steps=steps, evaluate_every=evaluate_every))
        )

    return {
        "GAIL": ours("gail"),
        "GAIL, evaluated at its ends alone": ours("gail", evaluate_every=10_000),
        "MixGAIL": ours("mixgail"),
        f"SSIL, {len(dataset):,} demonstrations": ours("ssil"),
        "sb3-contrib TRPO, real environments": lambda steps: rival(real(), steps),
        "sb3-contrib TRPO on the twin": lambda steps: rival(twin(), steps),
    }


def print_speeds(compared: dict[str, Callable[[int], object]]) -> None:
    """Print steps a second, medians over interleaved rounds, and their ratios to the last row's."""
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in compared}
    for run in compared.values():
        run(4_096)
    for _ in range(ROUNDS):
        for name, run in compared.items():
            wall, processor = time.perf_counter(), time.process_time()
            run(STEPS)
            spent = time.process_time() - processor, time.perf_counter() - wall
            found[name].append((STEPS / spent[0], STEPS / spent[1]))
    median = {
        name: [statistics.median(column) for column in zip(*rates, strict=True)]
        for name, rates in found.items()
    }
    (*_, rival_rate) = median.values()
    print(f"{STEPS:,} steps, medians of {ROUNDS} interleaved rounds, steps/s (× the last)")
    print(f"{'':>36}{'processor time':>22}{'wall time':>22}")
    for name, rates in median.items():
        cells = (f"{r:,.0f} ({r / b:.1f})" for r, b in zip(rates, rival_rate, strict=True))
        print(f"{name:>36}" + "".join(f"{cell:>22}" for cell in cells))


def print_shares(dataset: sd.Dataset) -> None:
    """Print which share of GAIL's time is whose."""
    profile = cProfile.Profile()
    profile.runcall(train, job(dataset, "gail", TrainSettings(steps=STEPS)))
    stats = pstats.Stats(profile).stats  # pyright: ignore[reportAttributeAccessIssue]
    whole = max(figures[3] for figures in stats.values())
    names = {
        ("rollout.py", "roll"): "driving",
        ("training.py", "_evaluation"): "evaluation",
        ("discriminator.py", "__call__"): "discriminator",
        ("trpo.py", "step"): "policy step",
        ("adversarial.py", "_fit_critics"): "critics",
    }
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
