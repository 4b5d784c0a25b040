"""Real demonstrations by others, with a known quality: what the defaults must be worth."""

import csv
import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import rankdata
from sklearn.metrics import roc_auc_score

import ssil_data as sd
from ssil_data.demonstrations import Episode, Pairs
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


def read_levels(folder: Path) -> tuple[list[Episode], np.ndarray]:
    """Return all episodes of a learner's checkpoints and its expert, 100 pairs labeled by seed 400.

    The labeled pairs are a stretch of one of the expert's episodes (ril_co).
    """
    rng = np.random.default_rng(400)
    episodes, of_expert = [], []
    chosen = int(rng.integers(10))
    for path in sorted(folder.iterdir()):
        with h5py.File(path) as file:
            states, actions, goes_on = (
                file[key][:] for key in ("obs_array", "act_array", "mask_array")
            )
        bounds = [0, *(np.flatnonzero(goes_on.ravel() == 0) + 1).tolist()]
        for number, (first, stop) in enumerate(itertools.pairwise(bounds)):
            is_expert = "1.0" in path.name
            cuts = [first, stop]
            if is_expert and number == chosen:
                begin = first + int(rng.integers(stop - first - 100))
                cuts = [first, begin, begin + 100, stop]
            for part, (low, high) in enumerate(itertools.pairwise(cuts)):
                labeled = len(cuts) > 2 and part == 1
                rows = slice(low, high)
                episodes.append(
                    Episode(
                        states[rows].astype(np.float32),
                        actions[rows].astype(np.float32),
                        labeled=labeled,
                    )
                )
                of_expert.append(np.full(high - low, is_expert))
    return episodes, np.concatenate(of_expert)


def test_the_default_recipe_tells_the_expert_of_half_cheetah_by_100_labels(
    shared_data: Path, tmp_path: Path
):
    """AUROC of leverage 1.0 at seed 400; the share of experts is .198, estimated .2 or so."""
    episodes, of_expert = read_levels(shared_data / "ril_co" / "HalfCheetah")
    dataset = sd.Store(tmp_path).create(
        "cheetah",
        episodes,
        state_names=[f"s{i}" for i in range(episodes[0].states.shape[1])],
        action_names=[f"a{i}" for i in range(episodes[0].actions.shape[1])],
    )
    run = sd.score(dataset, seed=400)
    unlabeled = ~dataset.per_pair("labeled").astype(bool)
    assert np.count_nonzero(~unlabeled) == 100
    leverage = dataset.leverage(run.name)[unlabeled]
    assert roc_auc_score(of_expert[unlabeled], leverage) >= 0.99
    assert run.expert_share == pytest.approx(of_expert[unlabeled].mean(), rel=0.25)
