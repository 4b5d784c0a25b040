"""What can be restored of a damaged dataset is, and the rest is said."""

import json
import random
from pathlib import Path

import pytest

from ssil_data.estimators import GPR
from ssil_data.scoring import score
from ssil_data.store.dataset import Dataset
from support.command_line import run
from support.demonstrations import drive


@pytest.fixture
def scored(dataset: Dataset) -> Dataset:
    """A dataset of two versions with a run."""
    newer = dataset.append([drive(99, 7)])
    score(newer, GPR(), run="run")
    return newer


def place_of(dataset: Dataset) -> Path:
    assert dataset.folder.local is not None
    return dataset.folder.local


def validate(dataset: Dataset, capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, dict]:
    """Run the command; return its exit status and what it printed."""
    capsys.readouterr()
    status = run("validate", dataset.name, "--store", place_of(dataset).parent, "--json", *words)
    return status, json.loads(capsys.readouterr().out)


def flip(path: Path, place: int, bit: int) -> None:
    data = bytearray(path.read_bytes())
    data[place] ^= 1 << bit
    path.write_bytes(data)


SMALL = ("*/_delta_log/*.json", "*/_acknowledged", "_acknowledged", "card.md", "models/*/*.json")


@pytest.mark.parametrize("kind", SMALL)
def test_a_flipped_bit_of_a_small_file_is_named_and_restored(
    scored: Dataset, kind: str, capsys: pytest.CaptureFixture[str]
):
    random.seed(400)
    paths = sorted(place_of(scored).glob(kind))
    assert paths
    for path in paths:
        whole = path.read_bytes()
        flip(path, random.randrange(len(whole)), random.randrange(8))
        status, found = validate(scored, capsys)
        assert status == 1
        assert str(path) in "".join(found["damaged"])
        status, found = validate(scored, capsys, "--repair")
        assert (status, found["damaged"]) == (0, [])
        assert str(path) in "".join(found["restored"])
        assert path.read_bytes() == whole


def test_what_cannot_be_restored_stays_as_it_is_and_is_named(
    scored: Dataset, capsys: pytest.CaptureFixture[str]
):
    (pairs, _) = sorted(place_of(scored).glob("pairs/*.parquet"))
    flip(pairs, 900, 1)
    entry = place_of(scored) / "leverage" / "_delta_log" / f"{0:020d}.json"
    entry.write_bytes(entry.read_bytes()[:-20])
    for _ in range(2):
        before = {path: path.read_bytes() for path in (pairs, entry)}
        status, found = validate(scored, capsys, "--repair")
        assert status == 1
        assert found["restored"] == []
        assert str(entry) in found["damaged"][0]
        assert {path: path.read_bytes() for path in (pairs, entry)} == before


def test_a_sound_dataset_is_left_as_it_is(scored: Dataset, capsys: pytest.CaptureFixture[str]):
    before = {path: path.stat().st_mtime_ns for path in place_of(scored).rglob("*")}
    assert validate(scored, capsys, "--repair") == (
        0,
        {"dataset": "drives", "version": scored.version, "damaged": [], "restored": []},
    )
    assert {path: path.stat().st_mtime_ns for path in place_of(scored).rglob("*")} == before


def test_a_torn_entry_of_an_older_version_is_set_aside_only_on_request(
    scored: Dataset, capsys: pytest.CaptureFixture[str]
):
    table = place_of(scored) / "episodes"
    (table / "_acknowledged").unlink()
    entry = table / "_delta_log" / f"{3:020d}.json"
    entry.write_bytes(b'{"commitInfo"')
    status, found = validate(scored, capsys)
    assert status == 1
    assert "nothing tells whether it was acknowledged" in found["damaged"][0]
    assert entry.exists()
    status, found = validate(scored, capsys, "--repair")
    assert (status, found["damaged"]) == (0, [])
    assert "set aside" in found["restored"][0]
    assert Dataset(scored.folder).version == scored.version
