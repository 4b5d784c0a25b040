"""A commit puts its entry, and those before it that are not yet on the disk, there."""

from pathlib import Path

import pytest
from deltalake import write_deltalake

from ssil_data.store import delta_log
from ssil_data.store.arrow_schema import EPISODES
from ssil_data.store.delta_table import VersionedTable
from ssil_data.store.folder import Folder


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    folder = Folder(tmp_path / "table")
    VersionedTable.create(folder, EPISODES)
    return folder


@pytest.fixture
def synced(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of what is synced, in order."""
    names: list[str] = []
    sync = delta_log.sync

    def spy(path: Path) -> None:
        names.append(path.name)
        sync(path)

    monkeypatch.setattr(delta_log, "sync", spy)
    return names


def rows(number: int):
    row = {"episode": number, "length": 1, "labeled": True, "source": "", "ending": "cut"}
    return EPISODES.empty_table().from_pylist([row], EPISODES)


def commit(folder: Folder, number: int) -> None:
    VersionedTable(folder).append([rows(number)], claim=("rows", number))


def entry(number: int) -> str:
    return f"{number:020d}.json"


def test_a_commit_syncs_its_own_entry_and_the_folders_however_long_the_log_is(
    folder: Folder, synced: list[str]
):
    for number in range(1, 12):
        synced.clear()
        commit(folder, number)
        assert synced == [entry(number), "_delta_log", "table"]


def test_the_first_commit_of_a_process_syncs_every_entry(
    folder: Folder, synced: list[str], monkeypatch: pytest.MonkeyPatch
):
    commit(folder, 1)
    commit(folder, 2)
    monkeypatch.setattr(delta_log, "_synced", {})  # as a process begins
    synced.clear()
    commit(folder, 3)
    assert sorted(synced[:-2]) == [entry(number) for number in range(4)]


def test_an_entry_that_another_process_wrote_is_synced_before_the_next_is_acknowledged(
    folder: Folder, synced: list[str]
):
    commit(folder, 1)
    write_deltalake(folder.delta_uri, rows(2), mode="append")
    synced.clear()
    commit(folder, 3)
    assert sorted(synced) == [entry(2), entry(3), "_delta_log", "table"]


def test_an_entry_that_takes_anothers_place_is_synced_again(folder: Folder, synced: list[str]):
    commit(folder, 1)
    path = Path(folder.uri) / "_delta_log" / entry(1)
    data = path.read_bytes()
    path.rename(path.with_suffix(".torn"))
    path.write_bytes(data)
    synced.clear()
    commit(folder, 2)
    assert entry(1) in synced
