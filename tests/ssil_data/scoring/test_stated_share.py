"""A share of experts that was stated and does not fit the data makes the run weak."""

from __future__ import annotations

import numpy as np
import pytest

import ssil_data as sd
from ssil_data.scales import Conformal, Posterior, Quantile
from ssil_data.scoring.stated_share import find_misfit
from ssil_data.store.dataset import Dataset
from support.command_line import run
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive

TRUE = 0.25


def draw(seed: int, *, share: float = TRUE, apart: float = 5) -> tuple[np.ndarray, np.ndarray]:
    """Return the uncertainty of a pool with so many experts, and of others held out."""
    rng = np.random.default_rng(seed)
    is_expert = rng.random(3000) < share
    pool = rng.normal(size=3000) + np.where(is_expert, 0, apart)
    return pool.astype(np.float32), rng.normal(size=100).astype(np.float32)


@pytest.mark.parametrize("share", [0.95, 0.9, 0.5, 0.25, 0.1])
@pytest.mark.parametrize("apart", [2, 4, 6])
@pytest.mark.parametrize("stretch", [1, 10])
def test_the_true_share_fits(share: float, apart: float, stretch: int):
    told = []
    for seed in range(400, 420):
        pool, held_out = draw(seed, share=share, apart=apart)
        told += find_misfit(Posterior(share), pool, held_out, stretch=stretch)
    assert [reason for reason in told if "cannot be checked" not in reason] == []


@pytest.mark.parametrize("stated", [0.01, 0.9])
def test_a_share_far_from_the_interval_is_told_with_both_numbers(stated: float):
    for seed in range(400, 410):
        pool, held_out = draw(seed, apart=6)
        estimated = Posterior().fit(pool, held_out, stretch=10)
        (reason,) = find_misfit(Posterior(stated), pool, held_out, stretch=10)
        assert reason.startswith(f"the stated expert share, {stated:g}, does not fit the data")
        assert f"{estimated.expert_share:.4g}" in reason


def test_a_share_a_little_beside_the_interval_fits():
    pool, held_out = draw(0, apart=6)
    low, high = Posterior().fit(pool, held_out).interval
    for stated in (low / 1.5, 1.5 * high):
        assert find_misfit(Posterior(stated), pool, held_out, stretch=1) == []


def test_where_nothing_is_known_no_share_can_be_checked():
    pool = np.zeros(100, np.float32)
    for stated in (0.01, 0.99):
        (reason,) = find_misfit(Posterior(stated), pool, None, stretch=1)
        assert reason.startswith(f"the stated expert share, {stated}, cannot be checked")
        assert "from 0.00 to 1.00" in reason


def test_a_stated_share_is_not_shown_with_an_interval(
    apart: Dataset, capsys: pytest.CaptureFixture[str]
):
    store = apart.folder.uri.rsplit("/", 1)[0]
    words = ("score", apart.name, "--estimator", "gpr", "--store", store)
    assert run(*words, "--expert-share", 0.5) == 0
    assert "Expert share of the unlabeled pairs: 0.500 (as stated)" in capsys.readouterr().out
    assert run(*words, "--run", "estimated") == 0
    assert "(90 % interval" in capsys.readouterr().out


@pytest.mark.parametrize("scale", [Posterior(), Quantile(), Conformal()])
def test_a_scale_without_a_stated_share_has_no_misfit(scale: sd.scales.Scale):
    pool, held_out = draw(0)
    assert find_misfit(scale, pool, held_out, stretch=1) == []


@pytest.fixture
def apart(store: sd.Store) -> Dataset:
    """Expert drives and as many that are far worse: the share of experts is plain."""
    episodes = [
        *(drive(seed, 60, labeled=True) for seed in range(4)),
        *(drive(10 + seed, 60) for seed in range(6)),
        *(drive(20 + seed, 60, spread=60) for seed in range(6)),
    ]
    return store.create("apart", episodes, state_names=STATE_NAMES, action_names=ACTION_NAMES)


def test_a_run_of_a_share_that_does_not_fit_is_weak_and_so_is_one_that_uses_it(apart: Dataset):
    dataset = apart
    recipe = sd.preset("default", "gpr")
    free = sd.score(dataset, recipe, run="free")
    fitting = sd.score(dataset, recipe.with_options(expert_share=0.5), run="fitting")
    assert fitting.weak == free.weak
    wrong = sd.score(dataset, recipe.with_options(expert_share=0.99), run="wrong")
    (reason,) = set(wrong.weak) - set(free.weak)
    assert free.expert_share is not None
    both = f"0.99, does not fit the data, which speak for {free.expert_share:.4g} "
    assert f"the stated expert share, {both}" in reason
    again = sd.rescore(dataset, dataset, "wrong", run="again")
    assert reason in again.weak


def test_the_command_says_that_a_stated_share_does_not_fit(
    apart: Dataset, capsys: pytest.CaptureFixture[str]
):
    place = ["--store", apart.folder.uri.rsplit("/", 1)[0]]
    words = ["score", apart.name, "--estimator", "gpr", "--expert-share", "0.99", *place]
    assert run(*words) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "Weak: gpr: the stated expert share, 0.99, does not fit the data" in shown
