"""The store keeps what it was given, shows it whole or not at all, and says what is wrong."""

import os
import random
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import polars as pl
import pyarrow.parquet as pq
import pytest
from deltalake import DeltaTable

from ssil_data.demonstrations import Episode
from ssil_data.errors import ConflictError, DamagedError, InvalidInputError, NotFoundError
from ssil_data.estimators import VAE
from ssil_data.scoring import score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_data.store.delta_log import set_torn_aside
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
def test_a_byte_flipped_within_a_page_fails_its_checksum_and_the_digest_of_its_file(
    dataset: Dataset, column: str, share: float, monkeypatch: pytest.MonkeyPatch
):
    (path,) = (local(dataset) / "pairs").glob("*.parquet")
    group = pq.ParquetFile(path).metadata.row_group(0)
    chunks = [group.column(i) for i in range(group.num_columns)]
    (chunk,) = [chunk for chunk in chunks if chunk.path_in_schema.split(".")[0] == column]
    flipped = bytearray(path.read_bytes())
    last = chunk.total_compressed_size - 1
    flipped[chunk.data_page_offset + int(share * last)] ^= 0xFF
    path.write_bytes(flipped)
    with pytest.raises(DamagedError, match=rf"{path.name}: expected {path.stem[5:]}, found"):
        Dataset(dataset.folder).pairs()
    # as in an object store, where files are read in parts
    monkeypatch.setattr(VersionedTable, "_check_digest", lambda self, file: None)
    with pytest.raises(DamagedError, match=rf"{path.name}.*CRC checksum"):
        Dataset(dataset.folder).pairs()


def test_a_flipped_bit_of_any_file_is_named_before_anything_is_read(dataset: Dataset):
    """Of ten places in each file."""
    dataset.append([drive(99, 7)])
    random.seed(400)
    for path in sorted(local(dataset).rglob("*")):
        if not path.is_file():
            continue
        whole = path.read_bytes()
        for _ in range(10):
            flipped = bytearray(whole)
            flipped[random.randrange(len(whole))] ^= 1 << random.randrange(8)
            path.write_bytes(flipped)
            with pytest.raises(DamagedError):
                read = Dataset(dataset.folder)
                _ = read.card, read.version, read.pairs(), read.runs.names()
        path.write_bytes(whole)
    assert Dataset(dataset.folder).find_damage() == []


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


@pytest.fixture
def unacknowledged(dataset: Dataset) -> tuple[Dataset, Dataset, Path]:
    """A dataset, its next version, whose commit is not acknowledged yet, and its entry."""
    record = local(dataset) / "episodes" / "_acknowledged"
    before = record.read_bytes()
    newer = dataset.append([drive(99, 7)])
    record.write_bytes(before)
    return dataset, newer, local(dataset) / "episodes" / "_delta_log" / f"{2:020d}.json"


@pytest.mark.parametrize("torn", [b"", b"\0" * 300, b'{"commitInfo": {"timest'])
def test_an_entry_that_a_power_cut_left_torn_is_passed_over_by_readers_and_set_aside_by_a_writer(
    unacknowledged: tuple[Dataset, Dataset, Path], torn: bytes
):
    dataset, _, entry = unacknowledged
    entry.write_bytes(torn)
    before = sorted(local(dataset).rglob("*"))
    reopened = Dataset(dataset.folder)
    assert reopened.version == dataset.version
    assert reopened.find_damage() == []
    assert sorted(local(dataset).rglob("*")) == before  # reading changes nothing
    newer = reopened.append([drive(98, 7)])
    assert newer.versions == [dataset.version, newer.version]
    assert newer.find_damage() == []
    (aside,) = entry.parent.glob("*.torn")
    assert aside.read_bytes() == torn


def test_an_entry_cut_between_two_lines_is_passed_over(
    unacknowledged: tuple[Dataset, Dataset, Path],
):
    dataset, newer, entry = unacknowledged
    lines = entry.read_text().splitlines()
    assert len(lines) == 3
    for kept in (1, 2):
        entry.write_text("\n".join(lines[:kept]))
        assert Dataset(dataset.folder).version == dataset.version
    entry.write_text("\n".join(lines))
    assert Dataset(dataset.folder).version == newer.version


def test_a_torn_entry_is_judged_again_under_the_lock(
    unacknowledged: tuple[Dataset, Dataset, Path], monkeypatch: pytest.MonkeyPatch
):
    dataset, newer, entry = unacknowledged
    table = local(dataset) / "episodes"
    judged = iter([entry])
    monkeypatch.setattr(
        "ssil_data.store.delta_log._find_torn", lambda table, record: next(judged, None)
    )
    assert set_torn_aside(table) is None
    assert entry.exists()
    assert Dataset(dataset.folder).version == newer.version


@pytest.mark.parametrize(
    ("table", "number"),
    [*((table, number) for table in ("pairs", "episodes") for number in range(3)), ("leverage", 0)],
)
def test_an_acknowledged_entry_that_rotted_is_damage_and_stops_writers(
    dataset: Dataset, table: str, number: int
):
    dataset.append([drive(99, 7)])
    entry = local(dataset) / table / "_delta_log" / f"{number:020d}.json"
    whole = entry.read_bytes()
    rotten = (
        whole[:-3],
        whole.replace(b"null", b"nul|", 1),
        b"",
        bytes([whole[0] ^ 1]) + whole[1:],
    )
    for data in rotten:
        entry.write_bytes(data)
        before = sorted(local(dataset).rglob("*"))
        with pytest.raises(DamagedError, match=f"{entry.name}: the log entry of version {number}"):
            opened = Dataset(dataset.folder)
            opened.runs.names()
            opened.append([drive(98, 7)])
        assert sorted(local(dataset).rglob("*")) == before
    entry.unlink()
    with pytest.raises(DamagedError, match="was acknowledged and is gone"):
        Dataset(dataset.folder).runs.names()


def test_versions_before_a_damaged_entry_can_still_be_read(dataset: Dataset):
    dataset.append([drive(99, 7)])
    (local(dataset) / "episodes" / "_delta_log" / f"{2:020d}.json").write_bytes(b"")
    assert Dataset(dataset.folder, 1).version == dataset.version


def test_the_record_of_what_was_acknowledged_is_under_a_digest_itself(dataset: Dataset):
    record = local(dataset) / "pairs" / "_acknowledged"
    whole = record.read_bytes()
    for place in range(len(whole)):
        record.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        with pytest.raises(DamagedError, match="the kept digests are not as they were written"):
            Dataset(dataset.folder)


def test_the_card_is_under_a_digest(dataset: Dataset):
    card = local(dataset) / "card.md"
    card.write_text(card.read_text().replace("Drives", "Draves"))
    with pytest.raises(DamagedError, match=r"card\.md: it is not as it was written"):
        _ = Dataset(dataset.folder).card
    assert Dataset(dataset.folder).find_damage() == [f"{card}: it is not as it was written"]


def test_a_log_that_was_never_acknowledged_and_promises_other_rows_is_damage(dataset: Dataset):
    """As version 0.1.0 left logs: without a record of their bytes."""
    (local(dataset) / "pairs" / "_acknowledged").unlink()
    entry = local(dataset) / "pairs" / "_delta_log" / f"{1:020d}.json"
    entry.write_text(entry.read_text().replace('\\"numRecords\\": 420', '\\"numRecords\\": 421'))
    reopened = Dataset(dataset.folder)
    for read in (lambda: len(reopened), lambda: reopened.version, lambda: score(reopened, VAE())):
        with pytest.raises(DamagedError, match="have 420 pairs, and the log of pairs has 421"):
            read()


def test_an_empty_log_of_pairs_hands_no_episode_number_out_again(dataset: Dataset):
    """As 0.1.0 left it, which set acknowledged entries aside."""
    log = local(dataset) / "pairs"
    (log / "_acknowledged").unlink()
    (log / "_delta_log" / f"{1:020d}.json").rename(log / "_delta_log" / f"{1:020d}.torn")
    reopened = Dataset(dataset.folder)
    with pytest.raises(DamagedError, match="have 420 pairs, and the log of pairs has 0"):
        len(reopened)
    with pytest.raises(DamagedError, match="have 420 pairs"):
        reopened.append([drive(98, 7)])


def test_a_log_of_an_older_version_gets_its_record_from_the_next_writer(dataset: Dataset):
    record = local(dataset) / "episodes" / "_acknowledged"
    whole = record.read_text().splitlines()
    record.unlink()
    newer = Dataset(dataset.folder).append([drive(99, 7)])
    assert record.read_text().splitlines()[:2] == whole[:2]
    assert newer.find_damage() == []


def test_many_commits_remove_nothing_of_the_history(store: Store):
    dataset = store.create(
        "long", [drive(0, 3)], state_names=STATE_NAMES, action_names=ACTION_NAMES
    )
    log = local(dataset) / "episodes" / "_delta_log"
    for number in range(1, 105):
        dataset = dataset.append([drive(number, 3)])
        for entry in log.iterdir():
            os.utime(entry, (0, 0))  # fifty years ago
    assert len(list(log.glob("*.json"))) == 106
    assert len(list(log.glob("*.checkpoint.parquet"))) == 1
    assert [path.name for path in log.parent.iterdir() if path.name.startswith(".")] == []
    versions = dataset.versions
    assert len(set(versions)) == 105
    assert dataset.at(versions[50]).version == versions[50]
    assert len(dataset.at(versions[50])) == 51 * 3
    (checkpoint,) = log.glob("*.checkpoint.parquet")
    data = checkpoint.read_bytes()
    checkpoint.write_bytes(bytes([data[0] ^ 1]) + data[1:])
    with pytest.raises(DamagedError, match=f"{checkpoint.name}: .* is not as it was acknowledged"):
        Dataset(dataset.folder)


def test_a_checkpoint_that_cannot_be_made_fails_no_commit(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("ssil_data.store.delta_log.EVERY", 1)

    def refuse(source: object, target: object) -> None:
        raise OSError(95, "Operation not supported")  # as file systems without links do

    monkeypatch.setattr("os.link", refuse)
    newer = dataset.append([drive(99, 7)])
    assert newer.find_damage() == []
    assert not list(local(dataset).glob("*/_delta_log/*.parquet"))
    assert not list(local(dataset).glob("*/.checkpoint-*"))
    monkeypatch.undo()
    assert newer.append([drive(98, 7)]).versions[:2] == newer.versions


def test_a_history_that_another_writer_cut_off_is_read_from_where_it_begins(dataset: Dataset):
    for number in range(3):
        dataset = dataset.append([drive(90 + number, 7)])
    versions = dataset.versions
    folder = local(dataset) / "episodes"
    (folder / "_acknowledged").unlink()
    DeltaTable(str(folder), version=3).create_checkpoint()
    for number in range(3):
        (folder / "_delta_log" / f"{number:020d}.json").unlink()
    reopened = Dataset(dataset.folder)
    assert reopened.versions == versions[2:]
    with pytest.raises(NotFoundError, match="version of drives: expected one of"):
        reopened.at(versions[0])


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
