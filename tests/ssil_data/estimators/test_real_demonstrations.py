"""Real demonstrations by others, with a known quality: what the defaults must be worth."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import rankdata
from sklearn.metrics import roc_auc_score

from ssil_data.demonstrations import Pairs
from ssil_data.estimators import GPR, MDN, VAE, Estimator
from ssil_data.scales import MinMax, Quantile

h5py = pytest.importorskip("h5py")


@pytest.fixture(scope="module")
def pendulum(shared_data: Path) -> tuple[Pairs, np.ndarray]:
    """All trajectories of ten noise levels (vild_code), the expert's first, and their returns."""
    states, actions, returns = [], [], []
    with (shared_data / "vild" / "returns.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["env"] == "Pendulum-v0"]
    for name in sorted({row["file"] for row in rows}):
        with h5py.File(shared_data / "vild" / "Pendulum-v0" / name) as file:
            states.append(file["expert_states"][:])
            actions.append(file["expert_actions"][:])
        returns += [float(row["return"]) for row in rows if row["file"] == name]
    episode, step = np.divmod(np.arange(200 * len(returns)), 200)
    return Pairs(np.vstack(states), np.vstack(actions), episode, step), np.array(returns)


@pytest.fixture(scope="module")
def cheetah(shared_data: Path) -> tuple[Pairs, Pairs, np.ndarray]:
    """600 confident rows (2IWIL), all 13,000 rows, and whether each is more likely expert."""
    both = np.load(shared_data / "kristery" / "HalfCheetah-v2_mixture.npy")
    confidence = np.load(shared_data / "kristery" / "HalfCheetah-v2_mixture_conf.npy")[:, 0]
    chosen = both[confidence > 0.999][:600]
    labeled, pool = (
        Pairs(rows[:, :17], rows[:, 17:], np.arange(len(rows)), np.zeros(len(rows), np.int64))
        for rows in (chosen, both)
    )
    return labeled, pool, confidence > 0.5


@pytest.mark.parametrize(
    ("estimator", "at_least"), [(VAE(), 0.9), (GPR(), 0.85)], ids=["vae", "gpr"]
)
def test_mean_leverage_ranks_pendulum_trajectories_by_return(
    pendulum: tuple[Pairs, np.ndarray], estimator: Estimator, at_least: float
):
    pairs, returns = pendulum
    uncertainty = estimator.fit(pairs[:1200], seed=0).uncertainty(pairs).total
    for scale in (MinMax(), Quantile()):
        leverage = scale.fit(uncertainty)(uncertainty).reshape(-1, 200).mean(axis=1)
        assert np.corrcoef(rankdata(leverage), rankdata(returns))[0, 1] >= at_least


@pytest.mark.parametrize(
    ("estimator", "at_least"),
    [(VAE(), 0.93), (GPR(), 0.96), (MDN(surprisal=True), 0.96)],
    ids=["vae", "gpr", "mdn with surprisal"],
)
def test_leverage_separates_expert_rows_of_half_cheetah(
    cheetah: tuple[Pairs, Pairs, np.ndarray], estimator: Estimator, at_least: float
):
    labeled, pool, is_expert = cheetah
    uncertainty = estimator.fit(labeled, seed=0).uncertainty(pool).total
    leverage = MinMax().fit(uncertainty)(uncertainty)
    assert roc_auc_score(is_expert, leverage) >= at_least
