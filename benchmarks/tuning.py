"""Which settings suit every method, and where do unlabeled pairs help?

`python benchmarks/tuning.py knobs` changes one setting at a time, for every method alike;
`python benchmarks/tuning.py lasts` runs some settings for the whole budget of the paper's table;
`python benchmarks/tuning.py pays` runs every method where leverage may be worth something;
without a question, the rows that are kept here are printed.
Scores are those of the learning curve: the mean action on the twin, or on Pendulum-v1 itself. Rows
are appended to a CSV as they are made, and those it has are not made again. One core.
"""

from __future__ import annotations

import os

os.environ |= {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}  # before NumPy and numba load

import csv
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import cyclopts
import numpy as np
import torch

import ssil_data as sd
from ssil_data.demonstrations import Episode
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.methods import METHODS
from ssil_trainers.envs.registry import make_vectorized
from ssil_trainers.experiments.fits import Fit, copy_dataset, limit_dataset
from ssil_trainers.experiments.statistics import Curve
from ssil_trainers.training.data import TrainingData
from ssil_trainers.training.run import train

DATASETS = Path(__file__).parents[1] / "datasets"
LABELED = 6
"""Pendulum: labeled trajectories of the expert."""
CUT = 2.0
"""Pendulum: the torque beyond which the environment clips."""


@dataclass(frozen=True)
class Problem:
    """Demonstrations and environment; `full` is the return that scores 1, None for the expert's."""

    dataset: str
    env: str
    labels: int | None = None
    steps: int = 61_440
    evaluate_every: int = 3
    full: float | None = None
    pretrained: bool = False


@dataclass(frozen=True)
class Run:
    """One training run; `changed` is the settings that are not the default, as JSON."""

    problem: str
    method: str
    changed: str
    seed: int


@dataclass(frozen=True)
class Result:
    """Its result: mean height of the curve, steps to .9, last score and mean of the last three."""

    area: float
    steps_to_90: int | None
    final: float
    last_three: float


PROBLEMS: Mapping[str, Problem] = {
    **{f"racetrack, {n} labels": Problem("racetrack", "racetrack", n) for n in (20, 50, 100, 300)},
    "racetrack, 50 labels, little driving": Problem(
        "racetrack", "racetrack", 50, 16_384, 1, pretrained=True
    ),
    **{
        f"racetrack, {n} labels, to the end": Problem("racetrack", "racetrack", n, 122_880, 5)
        for n in (100, 1_200)
    },
    "large track, 100 labels": Problem("racetrack", "racetrack?track=large", 100),
    "oval track, 100 labels": Problem("racetrack", "racetrack?track=oval", 100),
    "5 Hz, 100 labels": Problem("racetrack", "racetrack?policy_hz=5", 100),
    "RC car": Problem("rc-lidar", "rc-lidar", None, 16_384, 1, 400.0, pretrained=True),
    "RC car, 100 labels": Problem("rc-lidar", "rc-lidar", 100, 16_384, 1, 400.0, pretrained=True),
    "pendulum": Problem("pendulum", "Pendulum-v1", None, 122_880, 4, 1.0),
}
TUNED = ("racetrack, 100 labels", "pendulum")
FOUR = ("gail-mixed", "gail", "mixgail", "ssil")
SHAPED = ("mixgail", "ssil")
KNOBS: tuple[tuple[dict[str, Any], tuple[str, ...]], ...] = (
    ({}, FOUR),
    *(({"discriminator_rate": rate}, FOUR) for rate in (2e-4, 3e-4, 1e-3)),
    ({"kl": 0.02}, FOUR),
    ({"kl": 0.02, "discriminator_rate": 1e-3}, FOUR),
    ({"gradient_penalty": 0.1, "discriminator_rate": 1e-3}, FOUR),
    *(({"discriminator_steps": steps}, FOUR) for steps in (5, 20)),
    *(({"entropy": weight}, FOUR) for weight in (0.0, 0.01)),
    ({"centered": False}, SHAPED),
    *(({"eta": weight}, SHAPED) for weight in (0.3, 3.0)),
)
LASTING: tuple[dict[str, Any], ...] = (
    {"discriminator_rate": 5e-4},
    {"discriminator_rate": 1e-3},
    {"discriminator_rate": 1e-3, "gradient_penalty": 0.1},
)
LASTS = ("racetrack, 100 labels, to the end", "racetrack, 1200 labels, to the end")
AROUND = {"discriminator_rate": 5e-4}
"""What the default was when its knobs were turned."""


def list_runs(which: str, problems: tuple[str, ...], seeds: range) -> Iterator[Run]:
    """Yield the runs of a question, setting by setting."""
    every = tuple(name for name in METHODS if name != "constant")
    table, there = {
        "knobs": (tuple(({**AROUND, **changed}, methods) for changed, methods in KNOBS), TUNED),
        "lasts": (tuple((changed, FOUR) for changed in LASTING), LASTS),
        "pays": ((({}, every),), tuple(PROBLEMS)),
    }[which]
    for changed, methods in table:
        for problem in problems or there:
            for seed in seeds:
                for method in methods:
                    yield Run(problem, method, json.dumps(changed, sort_keys=True), seed)


def read_pendulum(folder: Path) -> Iterator[Episode]:
    """Read demonstrations of Pendulum-v0 as VILD published them: its expert's first, ten levels.

    A row of theirs holds the state after its action, in half-widths: the pair is (s_t, 2 a_t+1).
    """
    import h5py

    for path in sorted(folder.glob("*.h5")):
        with h5py.File(path) as file:
            keys = ("expert_states", "expert_actions", "expert_masks")
            states, actions, masks = (np.asarray(file[key]) for key in keys)
        ends = np.flatnonzero(masks == 0) + 1
        labeled = path.stem.endswith("normal0.00")
        for end in ends[:LABELED] if labeled else ends:
            start = end - int(ends[0])
            yield Episode(
                states[start : end - 1].astype(np.float32),
                np.clip(CUT * actions[start + 1 : end], -CUT, CUT).astype(np.float32),
                labeled=labeled,
                source=f"{path.stem}, row {start}",
            )


@dataclass(frozen=True)
class Bench:
    """Where copies of the demonstrations and their scoring runs are kept."""

    work: Path
    vild: Path | None

    @cache  # noqa: B019  lives as long as the script
    def data(self, problem: Problem, seed: int) -> TrainingData:
        """Read the demonstrations, windowVAE leverage, and the return that scores 1."""
        store = self._store(problem.dataset)
        name = limit_dataset(store, problem.dataset, problem.labels)
        fit = Fit.of(store, name, estimator="windowvae", preset="default", seed=seed)
        fit()
        data = TrainingData.read(store[name], fit.run, threads=1)
        full = problem.full or data.expert_return
        assert full is not None
        return replace(data, expert_return=full)

    def _store(self, name: str) -> sd.Store:
        if name != "pendulum":
            return copy_dataset(sd.Store(DATASETS), name, self.work)
        store = sd.Store(self.work / name)
        if name not in store:
            if self.vild is None:
                raise SystemExit(
                    "pendulum: name the folder of VILD's Pendulum-v0 demonstrations by --vild"
                )
            store.create(
                name,
                read_pendulum(self.vild),
                state_names=["cos", "sin", "speed"],
                action_names=["torque"],
            )
        return store

    def __call__(self, run: Run) -> Result:
        """Do one run."""
        problem = PROBLEMS[run.problem]
        defaults = TrainSettings(
            seed=run.seed,
            steps=problem.steps,
            evaluate_every=problem.evaluate_every,
            pretrained=problem.pretrained,
        )
        result = train(
            run.method,
            self.data(problem, run.seed),
            partial(make_vectorized, problem.env),
            settings=replace(defaults, **json.loads(run.changed)),
        )
        rows = [(row.steps, row.evaluation) for row in result.curve if row.evaluation is not None]
        scores = [evaluation.score or 0.0 for _, evaluation in rows]
        curve = Curve(tuple(steps for steps, _ in rows), tuple(scores))
        reached = curve.steps_to(0.9 if problem.full != 1.0 else -200.0)
        return Result(curve.area, reached, scores[-1], float(np.mean(scores[-3:])))


def read_rows(path: Path) -> dict[Run, Result]:
    """Read the rows of earlier calls."""
    if not path.exists():
        return {}
    with path.open() as file:
        return {
            Run(row["problem"], row["method"], row["changed"], int(row["seed"])): Result(
                float(row["area"]),
                int(row["steps_to_90"]) if row["steps_to_90"] else None,
                float(row["final"]),
                float(row["last_three"]),
            )
            for row in csv.DictReader(file)
        }


def append_row(path: Path, run: Run, found: Result) -> None:
    """Append a row."""
    row = {**asdict(run), **asdict(found)}
    fresh = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, list(row), lineterminator="\n")
        if fresh:
            writer.writeheader()
        writer.writerow(row)


def print_table(rows: Mapping[Run, Result]) -> None:
    """Print a line for each problem, change and method: means over seeds, and the worst."""
    groups: dict[tuple[str, str, str], list[Result]] = defaultdict(list)
    for run, found in rows.items():
        groups[run.problem, run.changed, run.method].append(found)
    print(f"{'':>66}{'seeds':>6}{'area':>9}{'to 90 %':>9}{'last three':>11}{'worst':>9}")
    for names, found in groups.items():
        steps = float(np.median([f.steps_to_90 or np.inf for f in found]))
        area = np.mean([f.area for f in found])
        last = [f.last_three for f in found]
        reached = f"{steps:,.0f}" if np.isfinite(steps) else "–"
        print(
            f"{names[0]:>24}{names[1]:>28}{names[2]:>14}{len(found):>6}"
            f"{area:>9.3f}{reached:>9}{np.mean(last):>11.3f}{min(last):>9.3f}"
        )


def main(
    question: Literal["knobs", "lasts", "pays"] | None = None,
    /,
    *,
    problems: tuple[str, ...] = (),
    seeds: int = 3,
    first_seed: int = 0,
    output: Path | None = None,
    work: Path = Path("build/tuning"),
    vild: Path | None = None,
) -> None:
    """Do the runs that are missing, and print a table of all; without a question, of those kept."""
    if question is None:
        print_table(read_rows(Path(__file__).with_suffix(".csv")))
        return
    torch.set_num_threads(1)
    path = output or work / f"{question}.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    bench = Bench(work, vild)
    done = read_rows(path)
    runs = list(list_runs(question, problems, range(first_seed, first_seed + seeds)))
    for run in runs:
        if run not in done:
            done[run] = bench(run)
            append_row(path, run, done[run])
            print(f"{run.problem}, {run.method} {run.changed} {run.seed}: {done[run].area:.3f}")
    print_table({run: done[run] for run in runs})


if __name__ == "__main__":
    cyclopts.run(main)
