"""Files of others become episodes, or are refused with the place where they are wrong."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ssil_data.errors import InvalidInputError, NotFoundError
from ssil_data.interop import Imported, Layout, imported, read_columns, read_states

ROWS = 12
COLUMNS = {
    "x": np.arange(ROWS, dtype=np.float64),
    "y": np.arange(ROWS, dtype=np.float64) * 2,
    "throttle": np.ones(ROWS),
    "drive": np.repeat([4, 7, 9], 4),
    "good": np.repeat([True, False, False], 4),
    "r": np.ones(ROWS) * 0.5,
}
LAYOUT = Layout(state=("y", "x"), action=("throttle",), episode="drive", reward="r")


def csv_file(folder: Path) -> Path:
    lines = [",".join(COLUMNS)]
    lines += [",".join(str(v[row]) for v in COLUMNS.values()) for row in range(ROWS)]
    return written(folder / "drives.csv", "\n".join(lines) + "\n")


def npz_file(folder: Path) -> Path:
    np.savez(folder / "drives.npz", **COLUMNS)
    return folder / "drives.npz"


def parquet_file(folder: Path) -> Path:
    pq.write_table(pa.table(COLUMNS), folder / "drives.parquet")
    return folder / "drives.parquet"


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def read(path: Path, layout: Layout = LAYOUT) -> Imported:
    return imported(read_columns(path), layout)


@pytest.mark.parametrize("make", [csv_file, npz_file, parquet_file])
def test_the_same_columns_of_any_format_are_the_same_episodes(tmp_path: Path, make):
    found = read(make(tmp_path))
    assert (list(found.state_names), list(found.action_names)) == (["y", "x"], ["throttle"])
    assert [len(episode) for episode in found.episodes] == [4, 4, 4]
    np.testing.assert_array_equal(found.episodes[1].states, [[8, 4], [10, 5], [12, 6], [14, 7]])
    assert [episode.score for episode in found.episodes] == [2.0, 2.0, 2.0]
    assert found.episodes[2].source.endswith("#9")


@pytest.mark.parametrize(
    ("labeled", "expected"),
    [
        ((), [False, False, False]),
        (("good",), [True, False, False]),
        (("7",), [False, True, False]),
        (("4", "9"), [True, False, True]),
        (("4,9",), [True, False, True]),
        (("4-7",), [True, True, False]),
        (("all",), [True, True, True]),
    ],
)
def test_labeled_episodes_are_chosen_by_column_value_or_range(
    tmp_path: Path, labeled: tuple[str, ...], expected: list[bool]
):
    layout = Layout(state=("x",), action=("throttle",), episode="drive", labeled=labeled)
    for make in (csv_file, npz_file, parquet_file):
        found = read(make(tmp_path), layout)
        assert [episode.labeled for episode in found.episodes] == expected


def test_arrays_of_the_usual_names_are_found(tmp_path: Path):
    np.savez(
        tmp_path / "plain.npz",
        states=np.ones((6, 3)),
        actions=np.ones((6, 2)),
        episode=np.repeat([0, 1], 3),
        labeled=np.repeat([1, 0], 3),
        tier=np.repeat(["expert", "0-25"], 3),
    )
    found = read(tmp_path / "plain.npz", Layout())
    assert list(found.state_names) == ["states[0]", "states[1]", "states[2]"]
    assert [(e.labeled, e.tier) for e in found.episodes] == [(True, "expert"), (False, "0-25")]


def test_parquet_lists_of_either_kind_are_matrices(tmp_path: Path):
    values = [[1.0, 2.0], [3.0, 4.0]]
    table = pa.table(
        {
            "state": pa.array(values, pa.list_(pa.float32())),
            "action": pa.array(values, pa.list_(pa.float64(), 2)),
        }
    )
    pq.write_table(table, tmp_path / "lists.parquet")
    found = read(tmp_path / "lists.parquet", Layout())
    np.testing.assert_array_equal(found.episodes[0].states, values)
    np.testing.assert_array_equal(found.episodes[0].actions, values)


def refused(path: Path, layout: Layout = LAYOUT) -> str:
    with pytest.raises((InvalidInputError, NotFoundError)) as refusal:
        read(path, layout)
    assert str(path) in str(refusal.value)
    return str(refusal.value)


@pytest.mark.parametrize("make", [csv_file, npz_file, parquet_file])
def test_an_unknown_column_is_refused_with_the_known_ones(tmp_path: Path, make):
    message = refused(make(tmp_path), Layout(state=("z",), action=("throttle",)))
    assert "found 'z'" in message
    assert "'throttle'" in message


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_what_is_not_a_finite_float32_is_refused_with_row_and_column(tmp_path: Path, value: float):
    columns = {**COLUMNS, "x": np.where(np.arange(ROWS) == 5, value, COLUMNS["x"])}
    np.savez(tmp_path / "bad.npz", **columns)
    pq.write_table(pa.table(columns), tmp_path / "bad.parquet")
    lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values()))]  # noqa: B905
    written(tmp_path / "bad.csv", "\n".join(lines))
    for suffix in ("npz", "parquet", "csv"):
        message = refused(tmp_path / f"bad.{suffix}")
        assert f"found {value} at row 5, column 'x'" in message


def test_csv_lines_of_another_length_and_empty_cells_are_refused(tmp_path: Path):
    path = csv_file(tmp_path)
    lines = path.read_text().splitlines()
    written(path, "\n".join([*lines[:7], "1,2", *lines[8:]]))
    assert "expected 6 columns as in the header, found 2 in line 8" in refused(path)
    written(path, "\n".join([*lines[:7], "1,,3,4,1,1", *lines[8:]]))
    assert "column 'y', found none in line 8" in refused(path)
    written(path, "\n".join([*lines[:7], "1,two,3,4,1,1", *lines[8:]]))
    assert "expected numbers in column 'y'" in refused(path)
    written(path, "")
    refused(path)


def test_the_broken_driving_log_is_refused_where_it_breaks(shared_data: Path):
    layout = Layout(state=("SPEED",), action=("STEERING",))
    message = refused(shared_data / "torcs" / "aalborg.csv", layout)
    assert "expected 24 columns as in the header, found 25 in line 2" in message


@pytest.mark.parametrize("make", [npz_file, parquet_file])
@pytest.mark.parametrize("kept", [0, 1, 100, 0.5, 0.99])
def test_truncated_files_are_refused(tmp_path: Path, make, kept: float):
    path = make(tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[: int(kept if kept >= 1 else kept * len(data))])
    assert "file" in refused(path)


def test_pickled_objects_are_never_loaded(shared_data: Path):
    columns = read_columns(shared_data / "expert" / "imitation_cartpole.npz")
    assert "infos" not in columns
    assert "acts" in columns


def test_real_lidar_traces_are_imported(shared_data: Path):
    path = shared_data / "icra" / "icra_19beam_derived.parquet"
    beams = tuple(f"lidar_{beam:02d}" for beam in range(19))
    layout = Layout(state=(*beams, "prev_steer"), action=("steer",), episode="trace", step="t")
    found = read(path, layout)
    assert (len(found.episodes), sum(map(len, found.episodes))) == (29, 8113)
    assert {episode.states.shape[1] for episode in found.episodes} == {20}


def test_rows_of_an_episode_must_be_adjacent_and_their_steps_rise_by_one(tmp_path: Path):
    np.savez(
        tmp_path / "mixed.npz",
        states=np.ones((4, 1)),
        actions=np.ones((4, 1)),
        episode=[1, 1, 2, 1],
    )
    assert "found episode 1 again at row 3" in refused(tmp_path / "mixed.npz", Layout())
    np.savez(
        tmp_path / "skips.npz", states=np.ones((4, 1)), actions=np.ones((4, 1)), step=[5, 6, 8, 9]
    )
    assert "expected step 7 at row 2 of episode 0, found 8" in refused(
        tmp_path / "skips.npz", Layout()
    )


def test_a_label_that_changes_within_an_episode_is_refused(tmp_path: Path):
    np.savez(
        tmp_path / "l.npz", states=np.ones((4, 1)), actions=np.ones((4, 1)), labeled=[1, 1, 0, 1]
    )
    assert "expected one labeled for episode 0, found another at row 2" in refused(
        tmp_path / "l.npz", Layout()
    )


def test_unknown_labeled_episodes_missing_columns_and_other_files_are_refused(tmp_path: Path):
    path = npz_file(tmp_path)
    message = refused(
        path, Layout(state=("x",), action=("throttle",), episode="drive", labeled=("5",))
    )
    assert "among [4, 7, 9]" in message
    assert "found '5'" in message
    assert "expected --action" in refused(path, Layout(state=("x",)))
    refused(tmp_path / "missing.npz")
    refused(written(tmp_path / "drives.txt", "x"))
    refused(tmp_path)


def test_states_to_ask_about_are_taken_by_name_or_by_order(tmp_path: Path):
    np.savez(tmp_path / "named.npz", y=[1.0, 2.0], x=[3.0, 4.0], other=[0.0, 0.0])
    np.testing.assert_array_equal(read_states(tmp_path / "named.npz", ["x", "y"]), [[3, 1], [4, 2]])
    np.save(tmp_path / "matrix.npy", np.ones((3, 2)))
    assert read_states(tmp_path / "matrix.npy", ["x", "y"]).shape == (3, 2)
    written(tmp_path / "plain.csv", "a,b\n1,2\n3,4\n")
    assert read_states(tmp_path / "plain.csv", ["x", "y"]).shape == (2, 2)
    with pytest.raises(InvalidInputError, match="expected width 3, found 2"):
        read_states(tmp_path / "matrix.npy", ["x", "y", "z"])
