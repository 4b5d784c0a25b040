"""What is read of the store is cached within bounds, and dropped with its dataset."""

import asyncio
import os
import shutil
from pathlib import Path

import httpx
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import ssil_data as sd
from ssil_data.store.dataset import Dataset
from ssil_service import embed
from ssil_service.queries.catalog import Catalog
from ssil_service.queries.snapshot import Snapshot
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive


def test_a_deleted_dataset_leaves_the_cache(local: sd.Store):
    async def read() -> Catalog:
        catalog = Catalog(local, 2**30)
        for name in ("drives", "others"):
            snapshot = await catalog.snapshot(name)
            await catalog.pairs(snapshot)
            await catalog.values(snapshot, "vae")
            await catalog.field(snapshot, "vae", None)
            await catalog.model(snapshot, "vae")
        return catalog

    shutil.copytree(Path(local.folder.uri) / "drives", Path(local.folder.uri) / "others")
    catalog = asyncio.run(read())
    size = catalog.cache.bytes
    values = len(catalog.cache)
    catalog.remove("drives")
    assert (2 * catalog.cache.bytes, 2 * len(catalog.cache)) == (size, values)
    catalog.remove("others")
    assert (catalog.cache.bytes, len(catalog.cache)) == (0, 0)


def test_a_change_in_the_same_tick_of_the_clock_is_seen(
    local: sd.Store, monkeypatch: pytest.MonkeyPatch
):
    """A file system may give two changes one time; a second later it would give another."""
    logs = [Path(local.folder.uri) / "drives" / t / "_delta_log" for t in ("episodes", "leverage")]
    first = [log.stat().st_mtime_ns for log in logs]
    catalog = Catalog(local, 2**30)
    tick = max(first) / 1e9

    def seen(after: float) -> Snapshot:
        monkeypatch.setattr("ssil_service.queries.catalog.time.time", lambda: tick + after)
        return asyncio.run(catalog.snapshot("drives"))

    assert len(seen(0.01).dataset) == 420
    longer = local["drives"].append([drive(9, 5)])
    for log, time in zip(logs, first, strict=True):
        os.utime(log, ns=(time, time))
    assert seen(0.02).version == longer.version
    settled = seen(1.0)
    assert settled.version == longer.version
    assert seen(2.0) is settled  # and nothing is read again


def test_a_field_of_another_alpha_shares_the_states_of_the_runs_own(
    local: sd.Store, states: np.ndarray, monkeypatch: pytest.MonkeyPatch
):
    built: list[str] = []
    field = Dataset.field

    def count_and_open(self: Dataset, run: str, **options: float) -> sd.LeverageField:
        built.append(run)
        return field(self, run, **options)

    async def read_fields(catalog: Catalog) -> list[sd.LeverageField]:
        snapshot = await catalog.snapshot("drives")
        return [await catalog.field(snapshot, "vae", alpha) for alpha in (3.0, None, 7.0, 3.0)]

    with monkeypatch.context() as patch:
        patch.setattr(Dataset, "field", count_and_open)
        catalog = Catalog(local, 2**30)
        found = asyncio.run(read_fields(catalog))
        assert built == ["vae"]
        assert [each.alpha for each in found] == [3, local["drives"].runs["vae"].alpha, 7, 3]
        assert found[0] is found[3] and found[0].states is found[1].states
    for alpha, each in ((3.0, found[0]), (7.0, found[2])):
        expected = local["drives"].field("vae", alpha=alpha)
        assert_array_equal(each.lcor(states).values, expected.lcor(states).values)
        assert_array_equal(each.cor(states), expected.cor(states))
        close = {"tolerance": 0.1, "relative": True}
        assert_array_equal(each.lcor(states, **close).values, expected.lcor(states, **close).values)


def test_fields_that_share_states_are_dropped_before_the_field_that_has_them(local: sd.Store):
    async def read_fields(catalog: Catalog) -> tuple[sd.LeverageField, ...]:
        snapshot = await catalog.snapshot("drives")
        own = await catalog.field(snapshot, "vae", None)
        other = await catalog.field(snapshot, "vae", 3.0)
        catalog.cache.capacity = catalog.cache.bytes
        await catalog.cache.get(("another", "drives"), lambda: ("another", 1))
        still = await catalog.field(snapshot, "vae", None)
        return own, still, other, await catalog.field(snapshot, "vae", 3.0)

    own, still, other, another = asyncio.run(read_fields(Catalog(local, 2**30)))
    assert own is still and other is not another


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


def test_a_damaged_dataset_is_500_and_not_404(http: httpx.Client, monkeypatch: pytest.MonkeyPatch):
    def damaged(self: object) -> None:
        raise sd.DamagedError("part-1.parquet: bits flipped")

    monkeypatch.setattr(Dataset, "pairs", damaged)
    assert http.get("v1/datasets/drives/pairs").status_code == 500


def test_a_dataset_is_deleted_unless_written_to_and_its_name_is_free_then(
    folder: Path, local: sd.Store
):
    with embed(folder, jobs=1) as first, embed(folder, jobs=1) as second:
        with local.open_for_writing("drives") as written:
            assert first.connection.client.delete("v1/datasets/drives").status_code == 409
            assert len(written.append([drive(9, 5)])) == 425
        assert len(first["drives"]) == len(second["drives"]) == 425
        second.delete("drives")
        assert "drives" not in first
        names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
        assert len(first.create("drives", [drive(0, 7)], **names)) == 7
        assert len(second["drives"]) == 7


def test_an_unknown_episode_is_404_and_not_304(http: httpx.Client):
    known = {"If-None-Match": "*"}
    path = "v1/datasets/drives/pairs"
    assert http.get(path, params={"episode": 3}, headers=known).status_code == 304
    assert http.get(path, params={"episode": 99}, headers=known).status_code == 404
