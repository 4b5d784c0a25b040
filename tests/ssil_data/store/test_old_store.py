"""A store that version 0.1.0 wrote, with its own spelling of some names, is read as it was."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from ssil_data.estimators import dump, load
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset

OLD = Path(__file__).parent / "old_store" / "drives"

LEVERAGE = {
    "vae": [0.95790142, 0.91889083, 0.7307772, 0.97972363, 1.0, 0.83662468, 0.91804790, 1.0],
    "gpr": [1.0] * 8,
}
"""The first eight values of each run, as the old code printed them."""


@pytest.fixture
def old(tmp_path: Path) -> Dataset:
    shutil.copytree(OLD, tmp_path / "drives")
    return Store(tmp_path)["drives"]


def test_an_old_store_is_whole_and_shows_its_runs(old: Dataset):
    assert old.find_damage() == []
    assert [run.name for run in old.runs] == ["vae", "gpr"]
    assert old.version == "6c787040767cab55"
    assert (old.runs["vae"].preset, old.runs["gpr"].scale) == (None, {"kind": "minmax"})
    for name, expected in LEVERAGE.items():
        assert old.leverage(name)[:8].tolist() == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("name", ["vae", "gpr"])
def test_an_old_model_gives_the_leverage_that_it_gave(old: Dataset, name: str):
    model = old.model(name)
    leverage = model(old.pairs()).leverage
    if name == "gpr":
        leverage = np.where(old.per_pair("labeled"), 1, leverage)
    np.testing.assert_allclose(leverage, old.leverage(name), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", ["vae", "gpr"])
def test_an_old_model_is_written_again_byte_for_byte(old: Dataset, name: str):
    data = old.runs.model(old.runs[name])
    assert dump(load(data)) == data


LATER = {
    "pooling": {"kind": "none"},
    "fitted_pooling": {"kind": "none"},
    "scale_floor": 0.0,
    "cross_fit": False,
    "self_training": False,
    "self_trained": 0,
    "labeled_episodes": None,
    "laps": None,
    "expert_share": None,
    "expert_share_interval": None,
    "effective_pairs": None,
    "weight_on_experts": None,
    "calibration_error": None,
    "held_out_auroc": None,
    "weak": [],
}
"""What records did not have: switched off, or not known."""


def test_an_old_record_is_written_again_with_the_same_keys_and_what_came_later_off(old: Dataset):
    (path,) = (OLD / "models" / "vae").glob("settings-*.json")
    assert old.runs["vae"].to_json() == {**json.loads(path.read_text()), **LATER}
