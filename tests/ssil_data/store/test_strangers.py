"""A store that a stranger made: nothing outside of it is read, nothing hangs, one message."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ssil_data.errors import DamagedError
from ssil_data.estimators import GPR
from ssil_data.scoring import score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_data.store.runs import digest
from support.command_line import run


@pytest.fixture
def scored(dataset: Dataset) -> Path:
    """The folder of a dataset with a run, and a secret beside the store."""
    score(dataset, GPR(), run="run")
    assert dataset.folder.local is not None
    folder = dataset.folder.local
    (folder.parent.parent / "secret.txt").write_text("secret")
    return folder


def read_all(folder: Path) -> None:
    """Read what a dataset has, as the store opens it."""
    dataset = Store(folder.parent)[folder.name]
    _ = dataset.card, dataset.version, dataset.versions, dataset.pairs()
    for record in dataset.runs:
        dataset.leverage(record.name)
        dataset.model(record.name)


def replace_file(path: Path, kind: str) -> None:
    """Put something in the place of a file."""
    moved = path.rename(path.parents[len(path.parts) - len(_root(path).parts) - 1] / "moved")
    if kind == "link":
        path.symlink_to(moved)
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.mkdir()


def _root(path: Path) -> Path:
    """Return the folder of the test, which the store lies in."""
    return next(parent for parent in path.parents if (parent / "secret.txt").exists())


FILES = (
    "card.md",
    "_acknowledged",
    "pairs/_acknowledged",
    "pairs/_delta_log/*0.json",
    "pairs/_delta_log/*1.json",
    "pairs/*.parquet",
    "episodes/*.parquet",
    "leverage/*/*.parquet",
    "models/run/*.json",
    "models/run/*.safetensors",
)


@pytest.mark.parametrize("pattern", FILES)
@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_a_link_out_of_the_store_or_a_pipe_is_no_file_of_it(
    scored: Path, pattern: str, kind: str, capfd: pytest.CaptureFixture[str]
):
    read_all(scored)
    (path,) = scored.glob(pattern)
    replace_file(path, kind)
    wanted = "leads out of" if kind == "link" else "it is no regular file"
    with pytest.raises(DamagedError, match=wanted):
        read_all(scored)
    status = run("validate", scored.name, "--store", scored.parent)
    out, err = capfd.readouterr()
    assert status == 1
    assert re.search(wanted, out)
    assert "Traceback" not in err


@pytest.mark.parametrize("table", ["pairs", "episodes", "leverage", "pairs/_delta_log"])
def test_a_folder_that_is_a_link_out_of_the_store_is_not_read(scored: Path, table: str):
    replace_file(scored / table, "link")
    with pytest.raises(DamagedError, match="leads out of"):
        read_all(scored)


def test_a_dataset_that_is_a_link_out_of_the_store_is_not_read(scored: Path):
    replace_file(scored, "link")
    with pytest.raises(DamagedError, match="leads out of"):
        read_all(scored)


def test_a_store_that_is_reached_by_a_link_is_read(scored: Path, tmp_path: Path):
    (tmp_path / "elsewhere").symlink_to(scored.parent)
    read_all(tmp_path / "elsewhere" / scored.name)


def forge_log(folder: Path, table: str, change: dict[str, Any]) -> None:
    """Change what the newest log entry says of its file, as a stranger who keeps no digests."""
    (folder / table / "_acknowledged").unlink()
    entry = sorted((folder / table / "_delta_log").glob("*.json"))[-1]
    lines = [json.loads(line) for line in entry.read_text().splitlines()]
    for line in lines:
        if "add" in line:
            line["add"] |= change
    entry.write_text("\n".join(map(json.dumps, lines)))


@pytest.mark.parametrize("table", ["pairs", "episodes", "leverage"])
@pytest.mark.parametrize(
    "change",
    [
        {"path": "../../../secret.txt"},
        {"path": "/etc/passwd"},
        {"path": "file:///etc/passwd"},
        {"path": "run=run/../../../../secret.txt"},
        {"path": "..%2F..%2F..%2Fsecret.txt"},
        {"stats": None},
        {"stats": "{}"},
        {"stats": json.dumps({"numRecords": 5})},
        {"stats": json.dumps({"numRecords": "x", "minValues": {"episode": "a"}})},
        {"stats": json.dumps({"numRecords": -5, "minValues": {"episode": None}})},
        {"partitionValues": {"run": "../../.."}},
    ],
    ids=str,
)
def test_a_forged_log_is_one_message_and_reads_nothing_elsewhere(
    scored: Path, table: str, change: dict[str, Any], capfd: pytest.CaptureFixture[str]
):
    if "partitionValues" in change and table != "leverage":
        change = {"partitionValues": {"other": "x"}, "path": "../x"}
    forge_log(scored, table, change)
    with pytest.raises(DamagedError):
        read_all(scored)
    assert run("validate", scored.name, "--store", scored.parent) == 1
    out, err = capfd.readouterr()
    assert "secret" not in out.replace("secret.txt", "")
    assert "Traceback" not in err


@pytest.mark.parametrize(
    "change",
    [
        {"run": "../../../elsewhere"},
        {"run": "other"},
        {"run": 5},
        {"seed": "x"},
        {"pairs": None},
        {"alpha": float("nan")},
        {"shift": [None]},
        {"scale": []},
        {"estimator": "x"},
        {"model": 5},
        {"unknown": 1},
        None,
    ],
    ids=str,
)
def test_a_forged_record_of_a_run_is_one_message(
    scored: Path, change: dict[str, Any] | None, capfd: pytest.CaptureFixture[str]
):
    (path,) = scored.glob("models/run/*.json")
    values = json.loads(path.read_text())
    data = json.dumps([] if change is None else values | change).encode()
    identity = digest(data)
    path.rename(path.with_name(f"settings-{identity}.json")).write_bytes(data)
    (scored / "leverage" / "_acknowledged").unlink()
    entry = sorted((scored / "leverage" / "_delta_log").glob("*.json"))[-1]
    claimed = re.sub(r'("version": ?)\d+', rf"\g<1>{int(identity, 16)}", entry.read_text())
    entry.write_text(claimed)
    with pytest.raises(DamagedError):
        read_all(scored)
    assert run("show", scored.name, "--store", scored.parent) == 2
    assert run("validate", scored.name, "--store", scored.parent) == 1
    assert "Traceback" not in capfd.readouterr().err


def test_a_record_names_no_model_elsewhere(scored: Path):
    model = "../../../../secret"
    (scored.parents[1] / "secret.safetensors").write_text("secret")
    record = replace(Store(scored.parent)[scored.name].runs["run"], model=f"x/{model}")
    with pytest.raises(DamagedError):
        Store(scored.parent)[scored.name].runs.model(record)
