"""The committed racetrack demonstrations are the paper's mixture; leverage tells their tiers."""

import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from ssil_data.quality import Quality, measure_quality
from ssil_data.scoring import preset, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from support.demonstrations import DATASETS

COMMITTED = DATASETS / "racetrack"
TIERS = ["0-25", "25-50", "50-75", "expert"]


@pytest.fixture
def racetrack(tmp_path: Path) -> Dataset:
    shutil.copytree(COMMITTED, tmp_path / "racetrack")
    return Store(tmp_path)["racetrack"]


def judge(dataset: Dataset, kind: str, preset_name: str) -> Quality:
    run = score(dataset, preset(preset_name, kind), seed=0)
    return measure_quality(dataset, dataset.leverage(run.name))


def test_the_mixture_is_half_expert_and_half_negative_beside_a_few_labeled_pairs(
    racetrack: Dataset,
):
    labeled, tier = racetrack.per_pair("labeled").astype(bool), racetrack.per_pair("tier")
    assert set(tier[labeled]) == {"expert"}
    names, counts = np.unique(tier[~labeled].astype(str), return_counts=True)
    assert labeled.sum() == 1_200
    assert dict(zip(names, counts, strict=True)) == {
        "0-25": 8_000,
        "25-50": 8_000,
        "50-75": 8_000,
        "expert": 24_000,
    }


def test_every_file_has_the_bytes_that_it_was_committed_with(racetrack: Dataset):
    assert racetrack.find_damage() == []


@pytest.mark.parametrize("scale", ["minmax", "quantile"])
@pytest.mark.parametrize(
    ("kind", "auroc", "length_matched"),
    [("vae", 0.97, 0.95), ("windowvae", 0.98, 0.97)],
    ids=["vae", "windowvae"],
)
def test_mean_leverage_rises_with_every_tier_and_tells_experts_apart(
    racetrack: Dataset, kind: str, scale: str, auroc: float, length_matched: float
):
    """The README's table has .979 and .966 for the vae, .988 and .980 for the windowvae."""
    recipe = preset("paper", kind).with_options(scale=scale)
    run = score(racetrack, recipe, seed=0)
    judged = measure_quality(racetrack, racetrack.leverage(run.name))
    means = list(judged.mean_leverage_by_tier.values())
    assert list(judged.mean_leverage_by_tier) == TIERS
    assert all(low < high for low, high in pairwise(means)), means
    assert judged.auroc is not None
    assert judged.auroc >= auroc
    assert judged.auroc_length_matched is not None
    assert judged.auroc_length_matched >= length_matched
    assert judged.spearman is not None
    assert judged.spearman >= {"vae": 0.65, "windowvae": 0.75}[kind]


@pytest.mark.parametrize("kind", ["vae", "windowvae"])
def test_by_default_experts_have_nearly_all_the_weight(racetrack: Dataset, kind: str):
    judged = judge(racetrack, kind, "default")
    *others, expert = judged.mean_leverage_by_tier.values()
    assert expert > 0.9
    assert max(others) < 0.1
    assert judged.auroc is not None
    assert judged.auroc >= 0.99


@pytest.mark.parametrize(("kind", "auroc"), [("mdn", 0.97), ("gpr", 0.96)])
def test_the_defaults_that_judge_actions_tell_experts_apart(
    racetrack: Dataset, kind: str, auroc: float
):
    """The README's table has .986 for the mdn with surprisal and .976 for the gpr."""
    judged = judge(racetrack, kind, "default")
    assert judged.auroc is not None
    assert judged.auroc >= auroc
    assert judged.mean_leverage_by_tier["expert"] > 0.8
    assert judged.mean_leverage_by_tier["0-25"] < 0.35
