"""A dataset is deleted whole, by one of many, and leaves a name that can be used again."""

import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from ssil_data.cli import main
from ssil_data.errors import ConflictError, InvalidInputError, NotFoundError
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_data.store.folder import Folder
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives

NAMES = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}


def place(store: Store) -> Path:
    assert store.folder.local is not None
    return store.folder.local


def test_a_deleted_dataset_is_gone_and_its_name_is_free(store: Store, dataset: Dataset):
    store.delete("drives")
    assert "drives" not in store
    assert list(place(store).iterdir()) == []
    assert len(store.create("drives", [drive(0, 5)], **NAMES)) == 5


@pytest.mark.parametrize(("name", "error"), [("nope", NotFoundError), ("../x", InvalidInputError)])
def test_only_a_dataset_is_deleted(name: str, error: type[Exception], store: Store):
    (place(store).parent / "x").mkdir()
    with pytest.raises(error):
        store.delete(name)
    assert (place(store).parent / "x").is_dir()


def test_a_dataset_is_not_deleted_while_it_is_open_for_writing(store: Store, dataset: Dataset):
    with store.open_for_writing("drives") as first, store.open_for_writing("drives"):
        with pytest.raises(ConflictError, match="drives"):
            store.delete("drives")
        assert len(first.append([drive(9, 4)])) == len(dataset) + 4
    store.delete("drives")


def test_an_error_of_a_writer_frees_the_dataset(store: Store, dataset: Dataset):
    with pytest.raises(BlockingIOError, match="the writer's own"), store.open_for_writing("drives"):
        raise BlockingIOError("the writer's own")
    store.delete("drives")


def test_a_writer_in_another_process_counts_until_it_ends(store: Store, dataset: Dataset):
    code = (
        "import sys, ssil_data.store as s\n"
        "with s.Store(sys.argv[1]).open_for_writing('drives'): print('writes', flush=True); input()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(place(store))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as writer:
        assert writer.stdout.readline() == b"writes\n"
        with pytest.raises(ConflictError):
            store.delete("drives")
        writer.kill()
        writer.wait()
        store.delete("drives")
    with pytest.raises(NotFoundError), store.open_for_writing("drives"):
        raise AssertionError("opened")


def test_of_several_deletes_at_once_one_succeeds(store: Store, dataset: Dataset):
    outcomes: list[str] = []
    barrier = threading.Barrier(8)

    def delete() -> None:
        barrier.wait()
        try:
            store.delete("drives")
        except (NotFoundError, ConflictError) as error:
            outcomes.append(type(error).__name__)
        else:
            outcomes.append("deleted")

    threads = [threading.Thread(target=delete) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (outcomes.count("deleted"), len(outcomes)) == (1, 8)
    assert list(place(store).iterdir()) == []


def test_remains_of_a_deleted_dataset_do_not_block_its_name(store: Store, dataset: Dataset):
    """An append without the store's lock makes the folder of its files anew."""
    store.delete("drives")
    (dataset.folder / "pairs").write("part-1.parquet", b"late")
    (dataset.folder / "models" / "vae").write("settings.json", b"late")
    assert "drives" not in store
    with pytest.raises(NotFoundError):
        store.delete("drives")
    assert len(store.create("drives", [drive(0, 5)], **NAMES)) == 5
    assert [path.name for path in place(store).iterdir()] == ["drives"]
    assert not (place(store) / "drives" / "models").exists()


def test_a_folder_that_is_no_dataset_is_left_alone(store: Store):
    (store.folder / "notes").write("mine.txt", b"kept")
    with pytest.raises(ConflictError, match="notes"):
        store.create("notes", drives(), **NAMES)
    assert (store.folder / "notes").read("mine.txt") == b"kept"


def test_remains_of_a_killed_delete_are_swept(
    store: Store, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
):
    def killed(folder: Folder) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Folder, "delete", killed)
        store.delete("drives")
    assert store.names() == []
    (left,) = place(store).iterdir()
    assert (left / "pairs").is_dir()
    store.sweep()
    assert list(place(store).iterdir()) == []


def test_folders_being_built_and_folders_of_others_are_not_swept(store: Store, dataset: Dataset):
    for kept in (".service/jobs", ".unfinished", ".backup.20261122"):
        (place(store) / kept).mkdir(parents=True)

    def episodes():
        yield drive(0, 5)
        store.sweep()
        yield drive(1, 5)

    assert len(store.create("built", episodes(), **NAMES)) == 10
    found = sorted(path.name for path in place(store).iterdir())
    assert found == [".backup.20261122", ".service", ".unfinished", "built", "drives"]


@pytest.mark.parametrize(
    "words", [["score", "drives", "--estimator", "vae"], ["import", "more.npz", "--append"]]
)
def test_commands_that_write_are_refused_a_dataset_that_is_being_deleted(
    words: list[str],
    store: Store,
    dataset: Dataset,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    given = drive(9, 4)
    arrays = {"states": given.states, "actions": given.actions}
    np.savez(tmp_path / "more.npz", allow_pickle=False, **arrays)
    monkeypatch.chdir(tmp_path)
    named = ["--name", "drives"] if words[0] == "import" else []
    with store._lock_dataset("drives", exclusive=True), pytest.raises(SystemExit) as status:
        main([*words, *named, "--store", str(place(store))])
    assert status.value.code == 2
    assert "is being deleted; try again later" in " ".join(capsys.readouterr().err.split())
    assert list(store["drives"].runs) == []
