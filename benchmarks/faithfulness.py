"""Where this reproduction chooses what the paper leaves open: what do the choices change?

`cor`: how far CoR is spread with the sharpness of LCoR and with its own. `mdn`: AUROC of the
paper's MDN uncertainty with all steps and stopped by held-out labels. `eta`: where η ends.
`expert`: the experts' returns without the noise on their actions; the racetrack's is trained again,
in five minutes, and on another kind of machine the same seed makes a slightly different driver.
Without a word: cor and mdn.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before NumPy and torch load

import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from ssil_data.estimators import MDN
from ssil_data.estimators.mdn import FittedMDN
from ssil_data.features import Standardizer
from ssil_data.field import auto_alpha
from ssil_data.kernels import Moments, cor
from ssil_data.quality import auroc
from ssil_data.scoring import preset, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.cor_sharpness import auto_cor_alpha
from ssil_trainers.collection.driver_training import DriverTrainer
from ssil_trainers.collection.pure_pursuit import PurePursuit
from ssil_trainers.collection.racetrack import RACETRACK, RacetrackSettings
from ssil_trainers.collection.rc_lidar import RC_LIDAR, RCSettings
from ssil_trainers.collection.recording import EvaluationCourse, Policy
from ssil_trainers.envs.registry import make_vectorized
from ssil_trainers.training.data import TrainingData
from ssil_trainers.training.expert_return import measure_expert_return
from ssil_trainers.training.label_subset import limit_labels
from ssil_trainers.training.run import train

DATASETS = Path(__file__).parent.parent / "datasets"
SEEDS = (0, 1, 2)
EPISODES = 100
"""Episodes that measure an expert."""


def print_cor(store: Store) -> None:
    """Print mean and deviation of CoR over the demonstrated states."""
    for name, labels in (("racetrack", 1_200), ("racetrack", 100), ("rc-lidar", 2_005)):
        dataset = limit_labels(store, name, labels)
        states = dataset.pairs().states
        labeled = dataset.per_pair("labeled").astype(bool)
        standardized = Standardizer.of(states)(states)
        expert = Moments.of(standardized[labeled])
        negative = Moments.of(standardized[~labeled])
        for whose, alpha in (
            ("LCoR's", auto_alpha(standardized)),
            ("its own", auto_cor_alpha(standardized, labeled)),
        ):
            found = cor(standardized, expert, negative, alpha)
            print(f"{name} {labels:5} labels, {whose} α {alpha:8.6g}: ", end="")
            print(f"CoR {found.mean():.3f} ± {found.std():.3f}")


def print_mdn(store: Store) -> None:
    """Print the AUROC of unlabeled expert pairs by the MDN's variances and by its surprisal."""
    for name in ("racetrack", "rc-lidar"):
        dataset = store[name]
        pairs = dataset.pairs()
        labeled = dataset.per_pair("labeled").astype(bool)
        expert = np.asarray(dataset.per_pair("tier"))[~labeled] == "expert"
        for hidden in (64, 256):
            for stop_early in (False, True):
                found = []
                for seed in SEEDS:
                    settings = MDN(hidden=hidden, stop_early=stop_early)
                    fitted = settings.fit(pairs.where(labeled), seed=seed)
                    assert isinstance(fitted, FittedMDN)
                    mixture = fitted.mixture(pairs.states)
                    judged = (
                        mixture.aleatoric() + mixture.epistemic(),
                        mixture.surprisal(fitted.actions(pairs.actions)),
                    )
                    sure = [-by[~labeled] for by in judged]
                    found.append([auroc(one[expert], one[~expert]) for one in sure])
                columns = zip(*found, strict=True)
                variances, surprisal = (" ".join(f"{x:.2f}" for x in column) for column in columns)
                how = "stopped early" if stop_early else "all steps"
                print(f"{name} {hidden:3} hidden, {how}: {variances}; surprisal {surprisal}")


def print_eta(store: Store) -> None:
    """Print η after each third of a training run on the racetrack, and its scores."""
    for labels in (1_200, 100):
        dataset = limit_labels(store, "racetrack", labels)
        score(dataset, preset("default", "windowvae"), seed=0, run="windowvae")
        for method in ("ssil", "mixgail"):
            for seed in SEEDS[:2]:
                result = train(
                    method,
                    TrainingData.read(dataset, "windowvae", threads=1),
                    lambda count: make_vectorized("racetrack", count),
                    settings=TrainSettings(seed=seed, evaluate_every=20),
                )
                rows = [row for row in result.curve if row.iteration is not None][19::20]
                found = " ".join(f"{row.iteration.eta:.2f}" for row in rows if row.iteration)
                print(f"{labels} labels, {method}, seed {seed}: η {found}")


def print_expert(store: Store) -> None:
    """Print the mean return of each expert with the noise on its actions and without."""
    settings = RacetrackSettings()
    course = EvaluationCourse(RACETRACK.make_env(settings), action_noise=settings.action_noise)
    trainer = DriverTrainer(
        lambda: RACETRACK.make_env(settings), course, 0, lambda what, done, of: None
    )
    expert = trainer.train_expert(settings.expert, measure=settings.measure)
    _print_returns(store["racetrack"], expert, RACETRACK.make_env(settings), settings.action_noise)
    rc = RCSettings()
    yard = RC_LIDAR.make_env(rc)
    _print_returns(store["rc-lidar"], PurePursuit(yard, ahead=rc.ahead), yard, rc.action_noise)


def _print_returns(
    dataset: Dataset, driver: Policy, env: gymnasium.Env[Any, Any], noise: float
) -> None:
    """Drive from the same starts with and without noise, beside the recorded mean return."""
    print(f"{dataset.name}, {driver}: recorded {measure_expert_return(dataset)}")
    for action_noise in (noise, 0.0):
        course = EvaluationCourse(env, first_seed=10_000, action_noise=action_noise)
        returns = course.measure_returns(driver, EPISODES)
        error = returns.std(ddof=1) / np.sqrt(EPISODES)
        print(f"  noise {action_noise:g}: {returns.mean():.2f} ± {error:.2f}, {EPISODES} episodes")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        copy = Store(shutil.copytree(DATASETS, Path(folder) / "store"))
        parts = {"cor": print_cor, "mdn": print_mdn, "eta": print_eta, "expert": print_expert}
        for word in sys.argv[1:] or ("cor", "mdn"):
            parts[word](copy)
