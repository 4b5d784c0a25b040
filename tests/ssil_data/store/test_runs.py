"""A run is shown whole or not at all, also with several writers and after a kill at any moment."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from ssil_data.errors import ConflictError, DamagedError, InvalidInputError, NotFoundError
from ssil_data.store import Store
from ssil_data.store.arrow_schema import fill_columns
from ssil_data.store.dataset import Dataset
from ssil_data.store.delta_table import VersionedTable
from ssil_data.store.folder import Folder
from ssil_data.store.run_record import Run
from ssil_data.store.runs import Runs, digest
from support.demonstrations import ACTION_NAMES, ROOT, STATE_NAMES, drive

MODEL = b"fitted" * 10_000

WRITER = """
import sys
sys.path.insert(0, sys.argv[1])
from test_runs import Folder, Dataset, write
dataset, first, count = Dataset(Folder(sys.argv[2])), int(sys.argv[3]), int(sys.argv[4])
print("ready", flush=True)
for number in range(first, first + count):
    write(dataset, f"run{number}")
    print(f"run{number}", flush=True)
"""


def record(dataset: Dataset, name: str, **changes: Any) -> Run:
    run = Run(
        name=name,
        dataset=dataset.name,
        dataset_version=dataset.version,
        estimator={"kind": "vae"},
        preset=None,
        scale={"kind": "minmax"},
        fitted_scale={},
        labeled_is_one=False,
        seed=0,
        pairs=len(dataset),
        labeled=120,
        seconds=0.0,
        alpha=1.0,
        shift=[0.0] * 3,
        spread=[1.0] * 3,
        created=f"2026-01-01T00:00:00+00:00 {name}",
        ssil_data="0",
        model=digest(MODEL),
    )
    return replace(run, **changes)


def values(dataset: Dataset, level: float = 0.5) -> pa.Table:
    pairs = dataset.pairs()
    column = pa.array(np.full(len(pairs), level, np.float32))
    parts = pa.nulls(len(pairs), pa.float32())
    written = pa.table(
        {
            "episode": pairs.episode,
            "step": pairs.step,
            "uncertainty": column,
            "aleatoric": parts,
            "epistemic": parts,
            "leverage": column,
        }
    )
    return fill_columns(written)


def write(dataset: Dataset, name: str, level: float = 0.5) -> None:
    dataset.runs.commit(record(dataset, name), MODEL, [values(dataset, level)])


def writer(dataset: Dataset, first: int, count: int) -> "subprocess.Popen[str]":
    arguments = [str(Path(__file__).parent), dataset.folder.uri, str(first), str(count)]
    command = [sys.executable, "-c", WRITER, *arguments]
    paths = [str(ROOT / "tests"), *sys.path]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env={"PYTHONPATH": ":".join(paths)}
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def test_a_run_gives_back_what_it_was_given(dataset: Dataset):
    write(dataset, "vae", 0.25)
    run = dataset.runs["vae"]
    assert run == record(dataset, "vae")
    assert dataset.runs.model(run) == MODEL
    assert dataset.leverage("vae").tolist() == [0.25] * len(dataset)
    assert dataset.runs.values("vae")["step"].to_pylist() == dataset.pairs().step.tolist()
    assert [run.name for run in dataset.runs] == ["vae"]
    assert dataset.field("vae").lcor(dataset.pairs().states[:3]).values == pytest.approx(0.25)


def test_a_name_is_used_once(dataset: Dataset):
    write(dataset, "vae")
    with pytest.raises(ConflictError, match="the name 'vae' is taken"):
        write(dataset, "vae", 0.9)
    assert set(dataset.leverage("vae").tolist()) == {0.5}
    assert dataset.runs.free_name("vae") == "vae-2"


def test_an_operation_opens_the_table_once(dataset: Dataset, monkeypatch: pytest.MonkeyPatch):
    write(dataset, "vae")
    runs = dataset.runs
    opened: list[str] = []
    begin = VersionedTable.__init__

    def count(self: VersionedTable, folder: Folder, version: int | None = None) -> None:
        opened.append(folder.uri)
        begin(self, folder, version)

    monkeypatch.setattr(VersionedTable, "__init__", count)
    with pytest.raises(NotFoundError):
        runs["gpr"]
    assert len(opened) == 1
    operations = [
        lambda: runs["vae"],
        lambda: runs.of_any_version("vae"),
        lambda: runs.values("vae"),
        lambda: runs.free_name("vae"),
        lambda: runs.check_unused("gpr"),
        lambda: runs.commit(record(dataset, "gpr"), MODEL, [chunk]),
        runs.find_damage,
        runs.names,
        runs.all,
        lambda: list(runs),
    ]
    chunk = values(dataset)
    for operation in operations:
        opened.clear()
        operation()
        assert len(opened) == 1


def test_of_two_writers_of_one_name_one_wins_whole(dataset: Dataset):
    def slow_values():
        write(dataset, "vae", 0.75)
        yield values(dataset, 0.25)

    with pytest.raises(ConflictError, match="run:vae"):
        dataset.runs.commit(record(dataset, "vae", seed=1), b"other", slow_values())
    assert set(dataset.leverage("vae").tolist()) == {0.75}
    assert dataset.runs["vae"].seed == 0
    assert dataset.runs.find_damage() == []


def test_a_run_of_another_version_is_refused(dataset: Dataset):
    write(dataset, "vae")
    newer = dataset.append([drive(99, 7)])
    with pytest.raises(ConflictError, match=f"version {newer.version} .* found version"):
        newer.leverage("vae")
    with pytest.raises(ConflictError):
        newer.field("vae")
    assert list(newer.runs) == []
    assert [run.name for run in newer.runs.all()] == ["vae"]
    assert newer.at(dataset.version).leverage("vae").shape == (len(dataset),)


def test_unknown_and_escaping_names_are_refused(dataset: Dataset):
    write(dataset, "vae")
    with pytest.raises(NotFoundError, match=r"expected one of \[vae\], found 'gpr'"):
        dataset.field("gpr")
    for name in ("../vae", "a/b", ""):
        with pytest.raises(InvalidInputError, match="run name"):
            dataset.leverage(name)
        with pytest.raises(InvalidInputError, match="run name"):
            write(dataset, name)


def test_a_damaged_model_or_record_is_found(dataset: Dataset):
    write(dataset, "vae")
    assert dataset.folder.local is not None
    for path in (dataset.folder.local / "models" / "vae").iterdir():
        whole = path.read_bytes()
        path.write_bytes(whole[:-1] + b"?")
        assert any(path.name in line for line in dataset.find_damage())
        with pytest.raises(DamagedError, match=path.name):
            dataset.runs.model(dataset.runs["vae"])
        path.write_bytes(whole)
    assert dataset.find_damage() == []


def test_after_a_kill_at_any_moment_runs_are_whole_or_absent(dataset: Dataset):
    rng = np.random.default_rng(0)
    acknowledged: set[str] = set()
    shown: set[str] = set()
    for round_ in range(8):
        process = writer(dataset, first=1000 * round_, count=1000)
        assert process.stdout is not None
        if round_ % 2:
            acknowledged.add(process.stdout.readline().strip())
        time.sleep(float(rng.uniform(0.0, 0.1)))
        process.send_signal(signal.SIGKILL)
        acknowledged |= set(process.stdout.read().split())
        process.wait()
        process.stdout.close()
        shown = {run.name for run in Dataset(dataset.folder).runs}
        assert acknowledged <= shown
        assert len(shown - acknowledged) <= round_ + 1
    assert acknowledged
    for name in shown:
        assert len(dataset.leverage(name)) == len(dataset)
    assert Dataset(dataset.folder).find_damage() == []


def test_two_processes_write_runs_at_once_and_none_is_lost(dataset: Dataset):
    processes = [writer(dataset, first=100 * number, count=15) for number in range(2)]
    for process in processes:
        process.communicate(timeout=60)
        assert process.returncode == 0
    assert len(list(dataset.runs)) == 30


def test_an_object_store_holds_datasets_and_runs(monkeypatch: pytest.MonkeyPatch):
    moto_server = pytest.importorskip("moto.server")
    server = moto_server.ThreadedMotoServer(port=0, verbose=False)
    server.start()
    try:
        host, port = server.get_host_and_port()
        for name, value in {
            "AWS_ENDPOINT_URL": f"http://{host}:{port}",
            "AWS_ACCESS_KEY_ID": "test",
            "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_REGION": "us-east-1",
            "AWS_ALLOW_HTTP": "true",
        }.items():
            monkeypatch.setenv(name, value)
        import boto3

        boto3.client("s3", region_name="us-east-1").create_bucket(Bucket="demonstrations")
        store = Store("s3://demonstrations/store")
        assert store.names() == []
        names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
        dataset = store.create("drives", [drive(0, 30, labeled=True)], card="# D", **names)
        write(dataset, "vae")
        assert store.names() == ["drives"]
        assert store["drives"].version == dataset.version
        assert store["drives"].leverage("vae").shape == (30,)
        assert store["drives"].find_damage() == []
        with pytest.raises(ConflictError):
            store.create("drives", [drive(0, 30)], **names)
    finally:
        server.stop()


def test_the_settings_file_is_plain_json(dataset: Dataset):
    write(dataset, "vae")
    (path,) = (Path(dataset.folder.uri) / "models" / "vae").glob("settings-*.json")
    assert json.loads(path.read_text())["run"] == "vae"
    assert Runs(dataset.folder, dataset.version)["vae"].name == "vae"


__all__ = ["Dataset", "Folder", "write"]
