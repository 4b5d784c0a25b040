"""What is read of the store is kept within bounds, and let go of with its dataset."""

import asyncio
import shutil
from pathlib import Path

import httpx
import pytest
from conftest import ACTION_NAMES, STATE_NAMES, drive
from ssil_service import embedded
from ssil_service.catalogue import Catalogue

import ssil_data as sd
from ssil_data.dataset import Dataset


def test_a_deleted_dataset_gives_its_memory_back(local: sd.Store):
    async def read() -> Catalogue:
        catalogue = Catalogue(local, 2**30)
        for name in ("drives", "others"):
            snapshot = await catalogue.snapshot(name)
            await catalogue.pairs(snapshot)
            await catalogue.values(snapshot, "vae")
            await catalogue.field(snapshot, "vae", None)
            await catalogue.model(snapshot, "vae")
        return catalogue

    shutil.copytree(Path(local.folder.uri) / "drives", Path(local.folder.uri) / "others")
    catalogue = asyncio.run(read())
    held, values = catalogue.cache.bytes, len(catalogue.cache)
    catalogue.remove("drives")
    assert (2 * catalogue.cache.bytes, 2 * len(catalogue.cache)) == (held, values)
    catalogue.remove("others")
    assert (catalogue.cache.bytes, len(catalogue.cache)) == (0, 0)


@pytest.mark.parametrize("path", ["pairs", "runs/vae/leverage", "card", "versions", ""])
def test_a_dataset_that_is_deleted_while_it_is_read_is_not_found(
    path: str, http: httpx.Client, local: sd.Store, monkeypatch: pytest.MonkeyPatch
):
    assert http.get("v1/datasets/drives").status_code == 200

    def gone(self: object) -> None:
        if "drives" in local:
            local.delete("drives")
        raise sd.DamagedError("part-1.parquet: no such file")

    for name in ("pairs", "runs", "card", "versions"):
        monkeypatch.setattr(Dataset, name, gone if name == "pairs" else property(gone))
    if path in ("runs/vae/leverage", ""):
        local["drives"].append([drive(9, 5)])  # the snapshot is read anew
    answer = http.get(f"v1/datasets/drives/{path}".rstrip("/"))
    assert (answer.status_code, answer.json()["title"]) == (404, "Not Found")


def test_damage_is_not_taken_for_a_deletion(http: httpx.Client, monkeypatch: pytest.MonkeyPatch):
    def damaged(self: object) -> None:
        raise sd.DamagedError("part-1.parquet: bits flipped")

    monkeypatch.setattr(Dataset, "pairs", damaged)
    assert http.get("v1/datasets/drives/pairs").status_code == 500


def test_a_dataset_is_deleted_when_nobody_writes_to_it_and_its_name_is_free(
    folder: Path, local: sd.Store
):
    with embedded(folder, jobs=1) as first, embedded(folder, jobs=1) as second:
        with local.writing("drives") as written:
            assert first.connection.client.delete("v1/datasets/drives").status_code == 409
            assert len(written.append([drive(9, 5)])) == 425
        assert len(first["drives"]) == len(second["drives"]) == 425
        second.delete("drives")
        assert "drives" not in first
        names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
        assert len(first.create("drives", [drive(0, 7)], **names)) == 7
        assert len(second["drives"]) == 7


def test_no_episode_is_no_unchanged_one(http: httpx.Client):
    known = {"If-None-Match": "*"}
    path = "v1/datasets/drives/pairs"
    assert http.get(path, params={"episode": 3}, headers=known).status_code == 304
    assert http.get(path, params={"episode": 99}, headers=known).status_code == 404
