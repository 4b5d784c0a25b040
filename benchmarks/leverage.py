"""Leverage that decides: recipes over labels and expert shares, by rank, weight and imitation.

    python benchmarks/leverage.py run --seeds 540-549 --output results.jsonl
    python benchmarks/leverage.py print results.jsonl

`run` fills the cells that the file lacks, one line each: it can be stopped and started again.
`--only TEXT` takes cells whose name contains it, `--jobs N` is the number of processes. Without a
file, the results that are kept here are printed. Recipes and the settings of training were tuned on
seeds 0-29, and no figure of those is a result: figures in the manual are of the seeds that its page
names.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before NumPy and torch load

import argparse
import json
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from parts.leverage_tables import format_tables
from parts.mixtures import MAKERS

from ssil_data.calibration import find_calibration
from ssil_data.estimators import Ensemble, WindowVAE
from ssil_data.pooling import HiddenMarkov, NoPooling
from ssil_data.quality import auroc, spearman
from ssil_data.scales import Quantile
from ssil_data.scoring import Recipe, preset, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.demonstrations import Demonstrations
from ssil_trainers.algorithms.rollout import measure_returns
from ssil_trainers.envs.rc_lidar.tracks import TEST_TRACKS, TRAINING_TRACK
from ssil_trainers.envs.registry import make_vectorized
from ssil_trainers.training.data import TrainingData
from ssil_trainers.training.expert_return import measured_returns
from ssil_trainers.training.run import train

DEFAULT = preset("default")
MEMBERS = Ensemble().members
BEFORE = Recipe(WindowVAE(), Quantile())
"""The default before this table: windowVAE, quantile scale, nothing pooled.

Its leverage is imitated as that of every recipe, by the weights `sure`, which is not what was done
with it before: the manual's page says so.
"""
RECIPES: dict[str, Recipe] = {
    "default": DEFAULT,
    "before": BEFORE,
    "paper": preset("paper", "windowvae"),
    **{
        f"only {kind}": preset("default", kind)
        for kind in ("vae", "windowvae", "mdn", "gpr", "contrast")
    },
    **{
        f"without {member.kind}": replace(
            DEFAULT, estimator=Ensemble(tuple(other for other in MEMBERS if other is not member))
        )
        for member in MEMBERS
    },
    "with windowvae": replace(DEFAULT, estimator=Ensemble((*MEMBERS, WindowVAE()))),
    "no floor": replace(DEFAULT, scale_floor=0.0),
    "no pooling": replace(DEFAULT, pooling=NoPooling()),
    "hmm": replace(DEFAULT, pooling=HiddenMarkov()),
    "quantile": replace(DEFAULT, scale=Quantile()),
    "no cross-fit": replace(DEFAULT, cross_fit=False),
    "self-training": replace(DEFAULT, self_training=True),
}
SHARES = (0.5, 0.09, 0.024)
"""Shares of the racetrack's mixtures: keys of `parts.mixtures.RACETRACK`."""
RESULTS = Path(__file__).with_suffix(".jsonl")
"""The results that the manual's tables are printed from."""
GAIL_STEPS = 16_384
CLONING_WEIGHT_DECAY = 1.0
"""Of every method alike, whether it ends with cloning or goes on from there."""


@dataclass(frozen=True)
class Cell:
    """A mixture, what is judged on it, and a seed.

    Parameters
    ----------
    kind, mixture
        Of `MAKERS`, with its arguments.
    recipe
        Of `RECIPES`; None for imitation that needs no run.
    methods
        What is trained.
    seed
        Of the mixture, the fit and the training.
    """

    kind: str
    mixture: dict[str, Any]
    recipe: str | None
    methods: tuple[str, ...] = ()
    seed: int = 0

    @property
    def name(self) -> str:
        """The cell's name."""
        mixture = " ".join(f"{key}={value}" for key, value in self.mixture.items())
        recipe = self.recipe or "no run"
        return f"{self.kind} {mixture} | {recipe} | {','.join(self.methods)} | {self.seed}"


def cells(seeds: list[int]) -> Iterator[Cell]:
    """Yield the cells of all parts, the most important first.

    Parameters
    ----------
    seeds
        All of them for what the manual claims, the first ones for the rest.
    """
    for seed in seeds:
        yield from _claims(seed)
    for seed in seeds[:3]:
        yield from _more_labels(seed)
    for seed in seeds[:2]:
        yield from _ablation(seed)


def _claims(seed: int) -> Iterator[Cell]:
    """Yield what the manual makes claims of."""
    clone = ("clone-leverage", "clone-posterior", "clone-ratio")
    for share in SHARES:
        mixture = {"labels": 50, "share": share}
        plain = ("clone", "clone-mixed", "gail", "gail-mixed")
        ours = ("clone-leverage", "clone-shuffled", "gail-leverage", "gail-shuffled")
        yield Cell("racetrack", mixture, None, plain, seed)
        yield Cell("racetrack", mixture, "default", ours, seed)
        yield Cell("racetrack", mixture, "before", ("clone-leverage", "gail-leverage"), seed)
        yield Cell("racetrack", mixture, "truth", ("clone-leverage", "gail-leverage"), seed)
    for labels in (300, 1200):
        for share in SHARES:
            mixture = {"labels": labels, "share": share}
            yield Cell("racetrack", mixture, None, ("clone",), seed)
            yield Cell("racetrack", mixture, "default", ("clone-leverage",), seed)
    mixture = {"labels": 401, "share": 0.63}
    yield Cell("rc-lidar", mixture, None, ("clone", "clone-mixed"), seed)
    yield Cell("rc-lidar", mixture, "default", clone, seed)
    yield Cell("rc-lidar", mixture, "truth", clone, seed)
    for labels in (401, 100):
        for share in (0.5, 0.1, 0.04):
            yield Cell("rc-lidar", {"labels": labels, "share": share}, "default", (), seed)
    for task in ("HalfCheetah", "Ant"):
        yield Cell("pybullet", {"labels": 100, "task": task}, "default", (), seed)
    yield Cell("cheetah", {"labels": 600}, "default", (), seed)
    yield Cell("pendulum", {"labels": 1200}, "default", (), seed)


def _more_labels(seed: int) -> Iterator[Cell]:
    """Yield what completes the table over labels."""
    clone = ("clone-leverage",)
    for labels in (20, 100, 300, 1200):
        for share in SHARES:
            mixture = {"labels": labels, "share": share}
            yield Cell("racetrack", mixture, "before", clone, seed)
            if labels < 300:
                yield Cell("racetrack", mixture, None, ("clone",), seed)
                yield Cell("racetrack", mixture, "default", clone, seed)
            yield Cell("racetrack", mixture, "default", ("gail-leverage",), seed)


def _ablation(seed: int) -> Iterator[Cell]:
    """Yield every recipe on every set."""
    for recipe in RECIPES:
        if recipe == "default":
            continue
        for share in SHARES:
            yield Cell("racetrack", {"labels": 50, "share": share}, recipe, (), seed)
        yield Cell("rc-lidar", {"labels": 401, "share": 0.5}, recipe, (), seed)
        for task in ("HalfCheetah", "Ant"):
            yield Cell("pybullet", {"labels": 100, "task": task}, recipe, (), seed)
        yield Cell("cheetah", {"labels": 600}, recipe, (), seed)
        yield Cell("pendulum", {"labels": 1200}, recipe, (), seed)


def fill(cell: Cell) -> dict[str, Any]:
    """Make the mixture, score it, imitate by it, and return the figures.

    Parameters
    ----------
    cell
        What to do.
    """
    with tempfile.TemporaryDirectory() as folder:
        store = Store(folder)
        dataset = MAKERS[cell.kind](store, "mixture", seed=cell.seed, **cell.mixture)
        expert = dataset.per_pair("tier") == "expert"
        labeled = dataset.per_pair("labeled").astype(bool)
        figures: dict[str, Any] = {}
        leverage = None
        if cell.recipe == "truth":
            leverage = expert.astype(np.float32)
        elif cell.recipe is not None:
            started = time.process_time()
            run = score(dataset, RECIPES[cell.recipe], seed=cell.seed)
            figures["seconds"] = time.process_time() - started
            leverage = dataset.leverage(run.name)
            figures |= {
                "estimated_share": run.expert_share,
                "interval": run.expert_share_interval,
                "held_out_auroc": run.held_out_auroc,
                "estimated_error": run.calibration_error,
                "weak": list(run.weak),
                "self_trained": run.self_trained,
            }
            figures |= judge(dataset, leverage[~labeled], expert[~labeled])
        for method in cell.methods:
            figures[method] = imitate(cell, dataset, leverage, method)
    return figures


def judge(dataset: Dataset, leverage: np.ndarray, expert: np.ndarray) -> dict[str, Any]:
    """Compare leverage of unlabeled pairs with the truth.

    Parameters
    ----------
    dataset
        The mixture.
    leverage, expert
        Of the unlabeled pairs, (n,).
    """
    weights = leverage.astype(np.float64)
    rows = dataset.episodes.to_pylist()
    episode = dataset.per_pair("episode")[~dataset.per_pair("labeled").astype(bool)]
    means = np.bincount(episode, weights) / np.maximum(np.bincount(episode), 1)
    unlabeled = [row for row in rows if not row["labeled"]]
    scores = [row["score"] for row in unlabeled]
    ranked = None
    if None not in scores:
        ranked = spearman([means[row["episode"]] for row in unlabeled], scores)
    return {
        "share": float(expert.mean()),
        "auroc": auroc(leverage[expert], leverage[~expert]),
        "weight_on_experts": float(weights[expert].sum() / weights.sum()) if weights.any() else 0.0,
        "calibration_error": find_calibration(leverage[expert], leverage[~expert]).error,
        "spearman": ranked,
    }


def imitate(cell: Cell, dataset: Dataset, leverage: np.ndarray | None, method: str) -> Any:
    """Train a policy on a mixture and return its score, the expert's without noise being 1.

    Parameters
    ----------
    cell
        What it is for.
    dataset
        The mixture.
    leverage
        Of every pair, (n,); None for none.
    method
        A method of the trainers, or `clone-posterior` and `clone-ratio`: by leverage, with another
        `expert_weighting`.
    """
    pairs = dataset.pairs()
    demonstrations = Demonstrations(
        pairs.states,
        pairs.actions,
        dataset.per_pair("labeled").astype(bool),
        leverage=leverage,
        threads=1,
    )
    known = {each["dataset"]: each["without_noise"] for each in measured_returns()}
    clone = method.startswith("clone")
    last = method.rsplit("-", 1)[-1]
    weighting: Any = last if last in ("posterior", "ratio") else "sure"
    settings = TrainSettings(
        seed=cell.seed,
        steps=0 if clone else GAIL_STEPS,
        pretrained=True,
        environments=16,
        horizon=32,
        gradient_penalty=1.0,
        evaluate_every=1_000,
        evaluations=16,
        cloning_weight_decay=CLONING_WEIGHT_DECAY,
        expert_weighting=weighting,
    )
    name = method.replace(f"-{weighting}", "-leverage")
    if cell.kind == "racetrack":
        data = TrainingData(demonstrations, known["racetrack"])
        trained = train(
            name, data, lambda count: make_vectorized("racetrack", count), settings=settings
        )
        last = trained.curve[-1].evaluation
        return None if last is None else last.score
    trained = train(
        name,
        TrainingData(demonstrations),
        lambda count: make_vectorized(f"rc-lidar?track={TRAINING_TRACK}", count),
        settings=settings,
    )
    scores = {}
    for track in (TRAINING_TRACK, *TEST_TRACKS):
        envs: Any = make_vectorized(f"rc-lidar?track={track}", 16)
        returns, _ = measure_returns(trained.policy, envs, seed=cell.seed)
        scores[track] = float(returns.mean() / envs.unwrapped.episode_steps)
    return scores


def parse_seeds(text: str) -> list[int]:
    """Read `400-409` or `400,403`.

    Parameters
    ----------
    text
        Numbers.
    """
    if "-" in text:
        first, last = text.split("-")
        return list(range(int(first), int(last) + 1))
    return [int(each) for each in text.split(",")]


def run(seeds: list[int], output: Path, only: str, jobs: int) -> None:
    """Fill the cells that a file lacks.

    Parameters
    ----------
    seeds
        Which.
    output
        The file of results.
    only
        A text in the names of cells; empty for all.
    jobs
        Processes.
    """
    done = {json.loads(line)["cell"] for line in output.open()} if output.exists() else set()
    open_cells = [cell for cell in cells(seeds) if only in cell.name and cell.name not in done]
    with ProcessPoolExecutor(jobs) as pool, output.open("a") as file:
        tasks = {pool.submit(fill, cell): cell for cell in open_cells}
        for count, task in enumerate(as_completed(tasks), start=1):
            cell = tasks[task]
            line = {"cell": cell.name, "kind": cell.kind, **cell.mixture}
            line["mixture_share"] = line.pop("share", None)
            line |= {"recipe": cell.recipe, "seed": cell.seed, **task.result()}
            file.write(json.dumps(line) + "\n")
            file.flush()
            print(f"{count}/{len(tasks)} {cell.name}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("command", nargs="?", choices=["run", "print"], default="print")
    parser.add_argument("file", nargs="?", type=Path, default=RESULTS)
    parser.add_argument("--output", type=Path)
    parser.add_argument("--seeds", default="540-549")
    parser.add_argument("--only", default="")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    given = parser.parse_args()
    if given.command == "print":
        print(format_tables([json.loads(line) for line in given.file.open()]), end="")
    else:
        run(parse_seeds(given.seeds), given.output, given.only, given.jobs)
