"""A leverage table of the first version gets the columns that came later, and loses nothing."""

from __future__ import annotations

import shutil
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

import ssil_data as sd
import ssil_data.store.runs
from ssil_data.errors import ConflictError
from ssil_data.estimators import Contrast, Ensemble, WindowVAE
from ssil_data.scoring.recipes import preset
from ssil_data.store import Store
from ssil_data.store.arrow_schema import LEVERAGE, VALUES, fill_columns
from ssil_data.store.dataset import Dataset
from ssil_data.store.delta_table import VersionedTable
from ssil_data.store.runs import digest
from support.demonstrations import ACTION_NAMES, DATASETS, STATE_NAMES, drives

FIRST = ["run", "episode", "step", "uncertainty", "aleatoric", "epistemic", "leverage"]
"""The columns of the first version."""

LATER = [name for name in VALUES.names if name not in FIRST]

SMALL = replace(preset("default"), estimator=Ensemble((WindowVAE(steps=20), Contrast(steps=20))))


@pytest.fixture
def old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Dataset:
    """A dataset whose leverage table has the old columns, and one run in them."""
    with monkeypatch.context() as patch:
        schema = pa.schema([LEVERAGE.field(name) for name in FIRST])
        patch.setattr(ssil_data.store.runs, "LEVERAGE", schema)
        made = Store(tmp_path / "store").create(
            "drives", drives(), state_names=STATE_NAMES, action_names=ACTION_NAMES
        )
        patch.setattr(VersionedTable, "add_columns", lambda self, schema: None)
        sd.score(made, sd.VAE(steps=20), run="old")
    assert columns(made) == FIRST
    return made


def columns(dataset: Dataset) -> list[str]:
    return VersionedTable(dataset.folder / "leverage").schema.names


def test_an_old_run_reads_with_nulls_and_reading_writes_nothing(old: Dataset):
    values = old.runs.values("old")
    assert values.schema.equals(VALUES)
    assert all(values[name].null_count == len(old) for name in LATER)
    assert values["uncertainty"].null_count == 0
    assert columns(old) == FIRST


def test_the_next_commit_adds_the_columns_and_old_runs_read_on(old: Dataset):
    before = old.runs.values("old")
    record = old.runs["old"]
    sd.score(old, SMALL, run="new")
    assert columns(old) == ["run", *FIRST[1:], *LATER]
    assert old.runs.values("old").equals(before)
    assert old.runs["old"] == record
    new = old.runs.values("new")
    known = {name for name in LATER if new[name].null_count == 0}
    assert known == {"pooled", "windowvae", "contrast"}
    assert {name for name in LATER if new[name].null_count == len(old)} == set(LATER) - known
    assert old.find_damage() == []


def test_the_columns_of_a_run_are_what_its_model_gives(old: Dataset):
    sd.score(old, SMALL, run="new")
    scored = old.model("new")(old.pairs())
    values = old.runs.values("new")
    np.testing.assert_array_equal(values["leverage"], scored.leverage)
    np.testing.assert_array_equal(values["pooled"], scored.pooled)
    for part in ("windowvae", "contrast"):
        np.testing.assert_array_equal(values[part], scored.parts[part])


def test_an_old_run_is_rescored(old: Dataset):
    again = sd.rescore(old, old, "old", run="again")
    np.testing.assert_array_equal(old.leverage("again"), old.leverage("old"))
    assert (again.model, again.pooling) == (old.runs["old"].model, {"kind": "none"})
    assert old.runs.values("again")["pooled"].null_count == len(old)


def test_a_reader_that_opened_before_stays_right(old: Dataset):
    table = VersionedTable(old.folder / "leverage")
    files = table.files()
    read = pa.Table.from_batches(list(table.batches(files, FIRST[1:])))
    reader = Store(old.folder.uri.rsplit("/", 1)[0])["drives"]
    before = reader.leverage("old")
    sd.score(old, SMALL, run="new")
    assert pa.Table.from_batches(list(table.batches(files, FIRST[1:]))).equals(read)
    assert [file.partition["run"] for file in table.files()] == ["old"]
    np.testing.assert_array_equal(reader.leverage("old"), before)
    assert sorted(reader.runs.names()) == ["new", "old"]
    np.testing.assert_array_equal(reader.leverage("new"), old.leverage("new"))


def write(dataset: Dataset, name: str, level: float) -> None:
    pairs = dataset.pairs()
    level_of_all = pa.array(np.full(len(pairs), level, np.float32))
    values = pa.table(
        {
            "episode": pairs.episode,
            "step": pairs.step,
            "uncertainty": level_of_all,
            "leverage": level_of_all,
            "pooled": level_of_all,
        }
    )
    record = replace(dataset.runs["old"], name=name, model=digest(b"model"))
    dataset.runs.commit(record, b"model", [fill_columns(values)])


@pytest.mark.parametrize("turn", range(3))
def test_of_writers_that_widen_a_table_at_once_none_is_lost_in_silence(old: Dataset, turn: int):
    before = old.runs.values("old")
    begin = threading.Barrier(4)
    refused: dict[str, Exception] = {}

    def commit(name: str, level: float) -> None:
        begin.wait()
        try:
            write(Store(old.folder.uri.rsplit("/", 1)[0])["drives"], name, level)
        except Exception as error:
            refused[name] = error

    levels = {f"run{number}": number / 8 for number in range(4)}
    threads = [threading.Thread(target=commit, args=pair) for pair in levels.items()]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(isinstance(error, ConflictError) for error in refused.values()), refused
    assert set(old.runs.names()) == {"old", *levels} - set(refused)
    for name, level in levels.items():
        if name not in refused:
            assert set(old.leverage(name).tolist()) == {level}
    for name in refused:
        write(old, name, levels[name])
    assert set(old.runs.names()) == {"old", *levels}
    assert old.runs.values("old").equals(before)
    assert columns(old) == ["run", *FIRST[1:], *LATER]
    assert old.find_damage() == []


def test_a_writer_that_opened_before_the_table_was_widened_succeeds_or_is_told(
    old: Dataset, monkeypatch: pytest.MonkeyPatch
):
    opened = VersionedTable(old.folder / "leverage")
    write(old, "first", 0.25)
    monkeypatch.setattr(type(old.runs), "_open_table", lambda self: opened)
    try:
        write(old, "second", 0.75)
    except ConflictError as error:
        assert "second" in str(error) or "columns" in str(error)
    monkeypatch.undo()
    assert {"old", "first"} <= set(old.runs.names())
    for name in old.runs.names():
        assert len(old.leverage(name)) == len(old)
    assert old.find_damage() == []


def test_the_committed_racetrack_takes_a_run_of_new_columns(tmp_path: Path):
    shutil.copytree(DATASETS / "racetrack", tmp_path / "racetrack")
    racetrack = Store(tmp_path)["racetrack"]
    sd.score(racetrack, sd.VAE(steps=1), run="one")
    assert set(VALUES.names) <= set(columns(racetrack))
    assert racetrack.find_damage() == []
