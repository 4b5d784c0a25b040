"""Parquet files of any text, dictionary or list type are read."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ssil_data.errors import InvalidInputError
from ssil_data.interop import Layout, read_states
from support.foreign_files import (
    read_episodes,
    refuse,
    write_parquet,
)


def test_parquet_lists_of_either_kind_are_matrices(tmp_path: Path):
    values = [[1.0, 2.0], [3.0, 4.0]]
    table = pa.table(
        {
            "state": pa.array(values, pa.list_(pa.float32())),
            "action": pa.array(values, pa.list_(pa.float64(), 2)),
        }
    )
    pq.write_table(table, tmp_path / "lists.parquet")
    found = read_episodes(tmp_path / "lists.parquet", Layout())
    np.testing.assert_array_equal(found.episodes[0].states, values)
    np.testing.assert_array_equal(found.episodes[0].actions, values)


@pytest.mark.parametrize("kind", [pa.string(), pa.large_string(), pa.string_view()])
def test_text_of_any_arrow_kind_is_text(tmp_path: Path, kind: pa.DataType):
    text = pa.array(["best", "best", "worst", "worst"], pa.string()).cast(kind)
    found = read_episodes(
        write_parquet(tmp_path, episode=text, tier=text), Layout(labeled=("best",))
    )
    assert [(e.tier, e.labeled) for e in found.episodes] == [("best", True), ("worst", False)]


def test_dictionary_columns_are_decoded(tmp_path: Path):
    text = pa.array(["best", "best", "worst", "worst"]).dictionary_encode()
    numbers = pa.array([5, 5, 6, 6]).dictionary_encode()
    found = read_episodes(write_parquet(tmp_path, episode=numbers, tier=text), Layout())
    assert [(e.tier, e.source) for e in found.episodes] == [
        ("best", "plain.parquet#5"),
        ("worst", "plain.parquet#6"),
    ]


def test_parquet_columns_that_cannot_be_read_are_refused_only_when_asked_for(tmp_path: Path):
    structs = pa.array([{"a": 1}] * 4)
    path = write_parquet(tmp_path, extra=structs)
    assert len(read_episodes(path, Layout()).episodes) == 1
    message = refuse(path, Layout(state=("extra",)))
    assert "expected numbers or text in column 'extra', found struct<a: int64>" in message
    assert "column 'tier', found struct" in refuse(write_parquet(tmp_path, tier=structs), Layout())
    texts = pa.array([["a"]] * 4)
    assert "found list" in refuse(write_parquet(tmp_path, episode=texts), Layout())
    with pytest.raises(InvalidInputError, match="in column 'extra', found struct"):
        read_states(write_parquet(tmp_path, extra=structs), ["state", "action", "extra"])


def test_real_lidar_traces_are_imported(shared_data: Path):
    path = shared_data / "icra" / "icra_19beam_derived.parquet"
    beams = tuple(f"lidar_{beam:02d}" for beam in range(19))
    layout = Layout(state=(*beams, "prev_steer"), action=("steer",), episode="trace", step="t")
    found = read_episodes(path, layout)
    assert (len(found.episodes), sum(map(len, found.episodes))) == (29, 8113)
    assert {episode.states.shape[1] for episode in found.episodes} == {20}
