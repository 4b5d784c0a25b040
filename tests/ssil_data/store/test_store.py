"""The store keeps what it was given, shows it whole or not at all, and says what is wrong."""

import os
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import polars as pl
import pyarrow.parquet as pq
import pytest

from ssil_data.demonstrations import Episode
from ssil_data.errors import ConflictError, DamagedError, InvalidInputError, NotFoundError
from ssil_data.estimators import VAE
from ssil_data.scoring import score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_data.store.delta_table import VersionedTable
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives


def local(dataset: Dataset) -> Path:
    assert dataset.folder.local is not None
    return dataset.folder.local


def test_a_dataset_gives_back_what_it_was_given(dataset: Dataset):
    given, pairs = drives(), dataset.pairs()
    assert len(dataset) == len(pairs) == sum(map(len, given))
    np.testing.assert_array_equal(pairs.states, np.concatenate([e.states for e in given]))
    np.testing.assert_array_equal(pairs.actions, np.concatenate([e.actions for e in given]))
    np.testing.assert_array_equal(pairs.step, np.concatenate([np.arange(len(e)) for e in given]))
    described = dataset.episodes.to_pylist()
    assert [row["score"] for row in described] == [e.score for e in given]
    assert [row["tier"] for row in described] == [e.tier for e in given]
    assert dataset.state_names == list(STATE_NAMES)
    assert dataset.card.startswith("# Drives\n")


def test_a_dataset_does_not_tell_where_it_was_made(dataset: Dataset):
    place = str(local(dataset).parent).encode()
    assert not any(place in path.read_bytes() for path in local(dataset).rglob("*.*"))


def test_the_card_ends_with_the_digest_of_every_file(dataset: Dataset):
    names = {path.stem.removeprefix("part-") for path in local(dataset).rglob("part-*.parquet")}
    assert len(names) == 2
    assert all(f"`{name}`" in dataset.card for name in names)
    assert f"Version `{dataset.version}`" in dataset.card


def test_batches_of_any_size_join_to_the_same_pairs(dataset: Dataset):
    for rows in (1, 7, 10_000):
        states = np.concatenate([batch.states for batch in dataset.batches(rows=rows)])
        np.testing.assert_array_equal(states, dataset.pairs().states)


def test_labeled_pairs_are_those_of_labeled_episodes(dataset: Dataset):
    assert set(dataset.labeled().episode.tolist()) == {0, 1}
    assert dataset.per_pair("labeled").sum() == len(dataset.labeled()) == 120


def test_an_episode_is_read_alone(dataset: Dataset):
    np.testing.assert_array_equal(dataset.episode(3).states, drives()[3].states)
    with pytest.raises(NotFoundError, match="expected 0 to 10, found 11"):
        dataset.episode(11)


def test_rewards_and_positions_are_optional(store: Store):
    plain, rich = (
        drive(1, 5),
        Episode(np.ones((4, 3)), np.ones((4, 2)), rewards=np.arange(4), positions=np.ones((4, 2))),
    )
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    assert store.create("mixed", [plain, rich], **names).read_recorded("position") is None
    recorded = store.create("rich", [rich], **names)
    assert recorded.read_recorded("reward").tolist() == [0, 1, 2, 3]
    assert recorded.read_recorded("position").shape == (4, 2)


def test_any_delta_reader_opens_the_tables(dataset: Dataset):
    frame = pl.read_delta(str(local(dataset) / "pairs"))
    assert frame.height == len(dataset)
    assert frame.schema["state"] == pl.List(pl.Float32)
    files = str(local(dataset) / "pairs" / "*.parquet")
    query = f"select count(*) from read_parquet('{files}') where len(state) = 3"
    assert duckdb.connect().execute(query).fetchall() == [(len(dataset),)]


def test_files_have_no_dictionary_for_numbers_and_are_compressed(dataset: Dataset):
    (path,) = (local(dataset) / "pairs").glob("*.parquet")
    group = pq.ParquetFile(path).metadata.row_group(0)
    assert all(not group.column(i).has_dictionary_page for i in range(group.num_columns))
    assert {group.column(i).compression for i in range(group.num_columns)} == {"ZSTD"}


@pytest.mark.parametrize("column", ["state", "action"])
@pytest.mark.parametrize("share", [0.25, 0.5, 0.75, 1.0])
def test_a_byte_flipped_within_a_page_fails_its_checksum(
    dataset: Dataset, column: str, share: float
):
    (path,) = (local(dataset) / "pairs").glob("*.parquet")
    group = pq.ParquetFile(path).metadata.row_group(0)
    chunks = [group.column(i) for i in range(group.num_columns)]
    (chunk,) = [chunk for chunk in chunks if chunk.path_in_schema.split(".")[0] == column]
    flipped = bytearray(path.read_bytes())
    last = chunk.total_compressed_size - 1
    flipped[chunk.data_page_offset + int(share * last)] ^= 0xFF
    path.write_bytes(flipped)
    with pytest.raises(DamagedError, match=rf"{path.name}.*CRC checksum"):
        Dataset(dataset.folder).pairs()


def test_appending_makes_a_version_and_keeps_the_earlier_one(dataset: Dataset):
    newer = dataset.append([drive(99, 7)])
    assert newer.version != dataset.version
    assert len(newer) == len(dataset) + 7
    assert newer.versions == [dataset.version, newer.version]
    assert len(newer.at(dataset.version)) == len(dataset)
    assert newer.episodes["episode"].to_pylist() == list(range(12))
    with pytest.raises(NotFoundError, match="found 'abc'"):
        newer.at("abc")


def test_the_version_is_a_fingerprint_of_the_contents(store: Store):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    first = store.create("first", drives(), **names)
    assert store.create("again", drives(), **names).version == first.version
    assert store.create("other", drives()[:-1], **names).version != first.version


def test_rows_of_an_append_that_was_killed_between_its_tables_are_never_read(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
):
    append = VersionedTable.append

    def killed(table: VersionedTable, *given: Any, **named: Any) -> None:
        if table.folder.uri.endswith("episodes"):
            raise KeyboardInterrupt
        append(table, *given, **named)

    with monkeypatch.context() as patch:
        patch.setattr(VersionedTable, "append", killed)
        with pytest.raises(KeyboardInterrupt):
            dataset.append([drive(99, 7)])
    reopened = Dataset(dataset.folder)
    assert reopened.version == dataset.version
    assert len(reopened) == len(dataset)
    assert len(reopened.append([drive(99, 7)])) == len(dataset) + 7


def test_two_appends_from_one_snapshot_conflict(dataset: Dataset, monkeypatch: pytest.MonkeyPatch):
    def episodes():
        Dataset(dataset.folder).append([drive(98, 3)])
        yield drive(99, 7)

    with pytest.raises(ConflictError, match="another writer"):
        dataset.append(episodes())
    assert len(Dataset(dataset.folder)) == len(dataset) + 3


def test_a_refused_dataset_leaves_nothing(store: Store, dataset: Dataset):
    before = sorted(path for path in Path(store.folder.uri).rglob("*"))
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    with pytest.raises(ConflictError, match="the name 'drives' is taken"):
        store.create("drives", drives(), **names)
    with pytest.raises(InvalidInputError, match="expected width 3, found 2"):
        store.create("narrow", [Episode(np.ones((4, 2)), np.ones((4, 2)))], **names)
    with pytest.raises(InvalidInputError, match="expected at least one, found none"):
        store.create("empty", [], **names)
    with pytest.raises(InvalidInputError, match="expected width 3, found 2"):
        dataset.append([Episode(np.ones((4, 2)), np.ones((4, 2)))])
    assert sorted(Path(store.folder.uri).rglob("*")) == before
    assert store.names() == ["drives"]


@pytest.mark.parametrize("name", ["../x", "a/b", "", ".hidden", "x" * 101, "a\0b", "..", "a b"])
def test_names_cannot_leave_the_store(store: Store, name: str):
    with pytest.raises(InvalidInputError, match="dataset name"):
        store[name]
    with pytest.raises(InvalidInputError, match="dataset name"):
        store.create(name, drives(), state_names=STATE_NAMES, action_names=ACTION_NAMES)


def test_an_unknown_dataset_is_refused_with_the_known_ones(store: Store, dataset: Dataset):
    with pytest.raises(NotFoundError, match=r"expected one of \[drives\] .* found 'other'"):
        store["other"]


def test_an_entry_that_a_power_cut_left_torn_is_set_aside(dataset: Dataset):
    dataset.append([drive(99, 7)])
    for torn in (b"", b'{"commitInfo": {"timest'):
        entry = local(dataset) / "episodes" / "_delta_log" / f"{2:020d}.json"
        entry.write_bytes(torn)
        reopened = Dataset(dataset.folder)
        assert reopened.version == dataset.version
        assert not entry.exists()


def test_an_entry_cut_between_two_lines_is_set_aside(dataset: Dataset):
    newer = dataset.append([drive(99, 7)])
    entry = local(dataset) / "episodes" / "_delta_log" / f"{2:020d}.json"
    lines = entry.read_text().splitlines()
    assert len(lines) == 3
    for kept in (1, 2):
        entry.write_text("\n".join(lines[:kept]))
        assert Dataset(dataset.folder).version == dataset.version
        assert not entry.exists()
    entry.write_text("\n".join(lines))
    assert Dataset(dataset.folder).version == newer.version


def test_a_torn_entry_is_judged_again_under_the_lock(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
):
    newer = dataset.append([drive(99, 7)])
    entry = local(dataset) / "episodes" / "_delta_log" / f"{2:020d}.json"
    judged = iter([entry])
    monkeypatch.setattr("ssil_data.store.delta_log._newest_torn", lambda folder: next(judged, None))
    assert Dataset(dataset.folder).version == newer.version
    assert entry.exists()


def test_a_broken_entry_in_the_middle_of_the_log_is_damage(dataset: Dataset):
    dataset.append([drive(99, 7)])
    (local(dataset) / "pairs" / "_delta_log" / f"{1:020d}.json").write_text("{")
    with pytest.raises(DamagedError, match="pairs: its log is damaged"):
        Dataset(dataset.folder)


def test_a_log_that_promises_more_rows_than_there_are_is_damage(dataset: Dataset):
    entry = local(dataset) / "pairs" / "_delta_log" / f"{1:020d}.json"
    entry.write_text(entry.read_text().replace('\\"numRecords\\": 420', '\\"numRecords\\": 421'))
    reopened = Dataset(dataset.folder)
    assert len(reopened) == 421
    assert "expected 421 rows as logged, found 420" in reopened.find_damage()[0]
    with pytest.raises(DamagedError, match="pairs: expected 421 as logged, found 420"):
        score(reopened, VAE())


def test_a_commit_syncs_data_then_log_then_folders(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
):
    synced: list[str] = []
    fsync = os.fsync

    def spy(handle: int) -> None:
        synced.append(Path(f"/proc/self/fd/{handle}").resolve().name)
        fsync(handle)

    monkeypatch.setattr("os.fsync", spy)
    dataset.append([drive(99, 7)])
    places = [
        next(i for i, name in enumerate(synced) if name.startswith(wanted))
        for wanted in (".part-", "pairs", f"{2:020d}.json", "_delta_log")
    ]
    assert places == sorted(places)
    assert synced[-1] == "episodes"


def test_a_store_lies_where_any_character_may_be_in_the_path(tmp_path: Path):
    for place in (tmp_path / "a b#?é", (tmp_path / "by uri").as_uri()):
        store = Store(place)
        made = store.create("drives", drives(), state_names=STATE_NAMES, action_names=ACTION_NAMES)
        assert len(store["drives"]) == len(made.pairs()) == 420
    assert (tmp_path / "by uri" / "drives").is_dir()


def test_a_store_that_cannot_be_is_refused():
    for place in ("foo://bar", "a%20b"):
        with pytest.raises(InvalidInputError, match="store: expected a"):
            Store(place)


def test_every_flipped_bit_is_found(dataset: Dataset):
    (path,) = (local(dataset) / "pairs").glob("*.parquet")
    whole = path.read_bytes()
    assert dataset.find_damage() == []
    for place in np.random.default_rng(0).integers(0, len(whole), 20):
        flipped = bytearray(whole)
        flipped[place] ^= 1
        path.write_bytes(flipped)
        assert any(path.name in line for line in dataset.find_damage())
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DamagedError, match=r"part-.*parquet"):
        Dataset(dataset.folder).pairs()
    path.unlink()
    assert any("the file is missing" in line for line in dataset.find_damage())
    with pytest.raises(DamagedError, match="there is none at"):
        Dataset(dataset.folder).pairs()


@pytest.mark.parametrize("given", [np.zeros((3, 3)), drive(0, 5).states, [1.0], None])
def test_what_is_no_episode_is_refused_and_nothing_is_written(store: Store, given: object):
    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    with pytest.raises(InvalidInputError, match="episode 1: expected an Episode, found"):
        store.create("odd", [drive(0, 5), given], **names)
    assert "odd" not in store
