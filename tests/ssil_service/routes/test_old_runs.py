"""Runs that were stored before pooling are served: what was not known of them is null."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd
from ssil_data.client import RemoteStore
from ssil_data.scoring import run_writer
from ssil_data.store import runs
from ssil_data.store.arrow_schema import FIRST_COLUMNS, LEVERAGE, VALUES
from ssil_service import embed
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drives

LATER = (
    *("pooling", "fitted_pooling", "scale_floor", "cross_fit", "self_training", "self_trained"),
    *("labeled_episodes", "laps", "expert_share", "expert_share_interval", "effective_pairs"),
    *("weight_on_experts", "calibration_error", "held_out_auroc", "weak"),
)
"""What records of the first version do not have."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A store as the first version wrote it: fewer columns in its table, fewer keys in a record."""
    to_json = sd.Run.to_json
    first = [VALUES.field(name) for name in FIRST_COLUMNS]

    def old_record(run: sd.Run) -> dict[str, Any]:
        return {name: value for name, value in to_json(run).items() if name not in LATER}

    with pytest.MonkeyPatch.context() as patch:
        for module in (run_writer, runs):
            patch.setattr(module, "VALUES", pa.schema(first))
        patch.setattr(runs, "LEVERAGE", pa.schema([LEVERAGE.field("run"), *first]))
        patch.setattr(sd.Run, "to_json", old_record)
        dataset = sd.Store(tmp_path / "store").create(
            "drives", drives(), state_names=STATE_NAMES, action_names=ACTION_NAMES
        )
        sd.score(dataset, sd.MDN(steps=10), run="old")
    return tmp_path / "store"


@pytest.fixture
def remote(folder: Path) -> Iterator[RemoteStore]:
    with embed(folder, jobs=1) as store:
        yield store


def test_the_store_is_as_the_first_version_wrote_it(folder: Path):
    (settings,) = folder.glob("drives/models/old/settings-*.json")
    assert not [name for name in LATER if f'"{name}"' in settings.read_text()]
    log = "".join(path.read_text() for path in folder.glob("drives/leverage/_delta_log/*.json"))
    assert "epistemic" in log and "pooled" not in log


def test_a_record_has_what_was_known_and_null_otherwise(remote: RemoteStore, folder: Path):
    record = remote.connection.client.get("v1/datasets/drives/runs/old").json()
    assert set(LATER) <= set(record)
    assert (record["pooling"], record["scale_floor"]) == ({"kind": "none"}, 0.0)
    assert (record["cross_fit"], record["self_training"], record["weak"]) == (False, False, [])
    unknown = ("labeled_episodes", "laps", "expert_share", "calibration_error", "held_out_auroc")
    assert [record[name] for name in unknown] == [None] * len(unknown)
    assert remote["drives"].runs["old"] == sd.Store(folder)["drives"].runs["old"]


def test_values_have_all_columns_and_the_model_answers(remote: RemoteStore, folder: Path):
    local = sd.Store(folder)["drives"]
    values = remote["drives"].runs.values("old")
    assert values.schema.names == VALUES.names
    assert values["pooled"].null_count == values["vae"].null_count == len(values)
    assert values.equals(local.runs.values("old"))
    scored = remote["drives"].model("old")(local.episode(3))
    assert_array_equal(scored.leverage, local.model("old")(local.episode(3)).leverage)
    assert_array_equal(scored.pooled, scored.uncertainty)


def test_a_pooled_run_goes_beside_the_old_one(remote: RemoteStore, folder: Path):
    before = remote["drives"].runs.values("old")
    recipe = sd.Recipe(sd.VAE(steps=10), sd.Posterior(), pooling=sd.Window(3))
    sd.score(remote["drives"], recipe, run="new")
    assert remote["drives"].runs.values("new")["pooled"].null_count == 0
    assert remote["drives"].runs.values("old").equals(before)
    again = sd.rescore(remote["drives"], remote["drives"], "old", run="again")
    assert again.pooling == {"kind": "none"}
    assert_array_equal(remote["drives"].leverage("again"), remote["drives"].leverage("old"))
