"""Files of others become episodes, or are refused with the place where they are wrong."""

import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ssil_data.demonstrations import Pairs
from ssil_data.errors import InvalidInputError, NotFoundError
from ssil_data.interop import Imported, Layout, import_episodes, read_columns, read_states

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
    return import_episodes(read_columns(path), layout)


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
    assert len(read(columns.path, Layout(state=("acts",), action=("acts",))).episodes) == 1
    message = refused(columns.path, Layout(state=("infos",), action=("acts",)))
    assert "expected numbers or text in column 'infos', found Python objects" in message


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
        tmp_path / "skips.npz", Layout(step="step")
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


def plain(folder: Path, **columns: Any) -> Path:
    """Write states and actions of four rows, and these arrays."""
    given = {"states": np.ones((4, 2)), "actions": np.ones((4, 1)), **columns}
    np.savez(folder / "plain.npz", **given)
    return folder / "plain.npz"


def plain_table(folder: Path, **columns: Any) -> Path:
    """Write state and action of four rows, and these columns, as Parquet."""
    table = {"state": [1.0, 2.0, 3.0, 4.0], "action": [0.0] * 4, **columns}
    pq.write_table(pa.table(table), folder / "plain.parquet")
    return folder / "plain.parquet"


@pytest.mark.parametrize("kind", [pa.string(), pa.large_string(), pa.string_view()])
def test_text_of_any_arrow_kind_is_text(tmp_path: Path, kind: pa.DataType):
    text = pa.array(["best", "best", "worst", "worst"], pa.string()).cast(kind)
    found = read(plain_table(tmp_path, episode=text, tier=text), Layout(labeled=("best",)))
    assert [(e.tier, e.labeled) for e in found.episodes] == [("best", True), ("worst", False)]


def test_dictionary_columns_are_decoded(tmp_path: Path):
    text = pa.array(["best", "best", "worst", "worst"]).dictionary_encode()
    numbers = pa.array([5, 5, 6, 6]).dictionary_encode()
    found = read(plain_table(tmp_path, episode=numbers, tier=text), Layout())
    assert [(e.tier, e.source) for e in found.episodes] == [
        ("best", "plain.parquet#5"),
        ("worst", "plain.parquet#6"),
    ]


def test_parquet_columns_that_cannot_be_read_are_refused_only_when_asked_for(tmp_path: Path):
    structs = pa.array([{"a": 1}] * 4)
    path = plain_table(tmp_path, extra=structs)
    assert len(read(path, Layout()).episodes) == 1
    message = refused(path, Layout(state=("extra",)))
    assert "expected numbers or text in column 'extra', found struct<a: int64>" in message
    assert "column 'tier', found struct" in refused(plain_table(tmp_path, tier=structs), Layout())
    texts = pa.array([["a"]] * 4)
    assert "found list" in refused(plain_table(tmp_path, episode=texts), Layout())
    with pytest.raises(InvalidInputError, match="in column 'extra', found struct"):
        read_states(plain_table(tmp_path, extra=structs), ["state", "action", "extra"])


def test_usual_arrays_of_python_objects_are_refused(tmp_path: Path):
    objects = np.array([{}, {}, {}, {}], dtype=object)
    assert "column 'labeled'" in refused(plain(tmp_path, labeled=objects), Layout())


@pytest.mark.parametrize(
    "name", ["actions", "episode", "step", "reward", "position", "score", "tier", "labeled"]
)
def test_every_used_column_has_the_rows_of_the_states(tmp_path: Path, name: str):
    wide = {"actions": (5, 1), "position": (5, 2)}
    path = plain(tmp_path, **{name: np.ones(wide.get(name, 5))})
    layout = Layout(step="step") if name == "step" else Layout()
    assert f"expected 4 rows in '{name}' as in 'states', found 5" in refused(path, layout)


def test_bytes_are_text_in_utf8_or_refused(tmp_path: Path):
    tiers = np.array(["bëst".encode()] * 4)
    assert read(plain(tmp_path, tier=tiers), Layout()).episodes[0].tier == "bëst"
    message = refused(plain(tmp_path, tier=np.array([b"\xff"] * 4)), Layout())
    assert "column 'tier', found bytes that are not UTF-8 text" in message


def test_columns_of_one_name_are_refused(tmp_path: Path):
    expected = "expected one column of each name, found 'x' twice"
    path = written(tmp_path / "twice.csv", "x,x\n1,2\n")
    assert expected in refused(path, Layout(state=("x",), action=("x",)))
    table = pa.Table.from_arrays([pa.array([1.0]), pa.array([2.0])], names=["x", "x"])
    pq.write_table(table, tmp_path / "twice.parquet")
    layout = Layout(state=("x",), action=("x",))
    assert expected in refused(tmp_path / "twice.parquet", layout)
    member = npz_member(np.ones(2))
    with (
        pytest.warns(UserWarning, match="Duplicate"),
        zipfile.ZipFile(tmp_path / "twice.npz", "w") as archive,
    ):
        archive.writestr("x.npy", member)
        archive.writestr("x.npy", member)
    assert expected in refused(tmp_path / "twice.npz", layout)


def npz_member(array: np.ndarray, *, header: dict[str, Any] | None = None) -> bytes:
    given = header or {"descr": array.dtype.str, "fortran_order": False, "shape": array.shape}
    text = (str(given) + "\n").encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + array.tobytes()


@pytest.mark.parametrize(
    ("data", "line"),
    [
        (b"st\xe9ate,action\n1,2\n", 1),
        (b"state,action\n\xe9,2\n", 2),
        (b"state,action\n1,2\n1,2,\xe9\n", 3),
    ],
)
def test_csv_that_is_not_utf8_is_refused_with_its_line(tmp_path: Path, data: bytes, line: int):
    (tmp_path / "latin.csv").write_bytes(data)
    message = refused(tmp_path / "latin.csv", Layout())
    assert f"expected UTF-8 text, found byte 0xe9 in line {line}" in message


def test_files_without_rows_are_refused(tmp_path: Path):
    expected = "expected at least one row, found none"
    assert expected in refused(written(tmp_path / "none.csv", "state,action\n"), Layout())
    np.savez(tmp_path / "none.npz", states=np.ones((0, 2)), actions=np.ones((0, 1)))
    assert expected in refused(tmp_path / "none.npz", Layout())
    lists = pa.array([], pa.list_(pa.float32()))
    pq.write_table(pa.table({"state": lists, "action": lists}), tmp_path / "none.parquet")
    assert expected in refused(tmp_path / "none.parquet", Layout())
    for name in ("none.csv", "none.npz", "none.parquet"):
        with pytest.raises(InvalidInputError, match=expected):
            read_states(tmp_path / name, ["x", "y"])


def test_files_without_columns_are_refused(tmp_path: Path):
    pq.write_table(pa.table({}), tmp_path / "none.parquet")
    np.savez(tmp_path / "none.npz")
    for name in ("none.parquet", "none.npz"):
        assert "expected at least one column, found none" in refused(tmp_path / name, Layout())


def test_a_corrupt_deflate_stream_is_refused(tmp_path: Path):
    path = tmp_path / "deflated.npz"
    np.savez_compressed(path, states=np.random.default_rng(0).normal(size=(200, 3)))
    data = bytearray(path.read_bytes())
    for seed in range(30):
        broken = bytearray(data)
        for place in np.random.default_rng(seed).integers(60, len(data) - 120, 20):
            broken[place] ^= 0xFF
        path.write_bytes(broken)
        assert "expected a NumPy file" in refused(path, Layout())


def test_an_encrypted_archive_is_refused(tmp_path: Path):
    path = plain(tmp_path)
    data = bytearray(path.read_bytes())
    for signature, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        place = data.find(signature)
        while place >= 0:
            data[place + flags] |= 1
            place = data.find(signature, place + 1)
    path.write_bytes(data)
    assert "encrypted" in refused(path, Layout())


def test_a_member_that_is_no_array_is_refused_only_when_asked_for(tmp_path: Path):
    path = plain(tmp_path)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("notes.txt", "hello")
    assert len(read(path, Layout()).episodes) == 1
    assert "found a member that is no NumPy array" in refused(path, Layout(state=("notes.txt",)))


def test_a_header_that_claims_more_rows_than_fit_is_refused(tmp_path: Path):
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**13, 2)}
    member = npz_member(np.ones(4), header=header)
    (tmp_path / "huge.npy").write_bytes(member)
    assert "expected a NumPy file" in refused(tmp_path / "huge.npy", Layout())
    with zipfile.ZipFile(tmp_path / "huge.npz", "w") as archive:
        archive.writestr("states.npy", member)
    assert "expected a NumPy file" in refused(tmp_path / "huge.npz", Layout())


@pytest.mark.parametrize(
    ("score", "expected"),
    [
        (np.array(["good"] * 4), "expected numbers in column 'score', found 'good'"),
        (np.ones((4, 3)), "expected one value per row in column 'score', found shape (4, 3)"),
        (np.array([1, 1, np.nan, 1]), "found nan at row 2, column 'score'"),
        (np.array([1, 1, 2, 1]), "expected one score for episode 0, found another at row 2"),
    ],
)
def test_a_score_is_one_number_per_episode(tmp_path: Path, score: np.ndarray, expected: str):
    assert expected in refused(plain(tmp_path, score=score), Layout(score="score"))


def test_a_range_of_episodes_passes_over_what_only_looks_like_a_number(tmp_path: Path):
    path = plain(tmp_path, episode=np.array(["²", "1", "3", "x"]))
    found = read(path, Layout(labeled=("1-3",)))
    assert [e.labeled for e in found.episodes] == [False, True, True, False]
    assert "found '²-³'" in refused(path, Layout(labeled=("²-³",)))


@pytest.mark.parametrize(
    "arrays",
    [
        {"x": np.ones(3), "y": np.ones(4)},
        {"x": np.array([{}], dtype=object)},
        {"x": np.ones((2, 2, 2))},
        {"x": np.ones((3, 0))},
        {"x": np.float64(1)},
        {"x": np.array(["a", "b"]), "y": np.ones(2)},
    ],
)
def test_states_to_ask_about_are_refused_if_they_are_none(tmp_path: Path, arrays: dict[str, Any]):
    path = tmp_path / "states.npz"
    np.savez(path, **arrays)
    with pytest.raises(InvalidInputError, match=r"states\.npz: expected .*, found"):
        read_states(path, ["x", "y"])
    np.save(tmp_path / "scalar.npy", np.float64(1))
    with pytest.raises(InvalidInputError, match="found a scalar"):
        read_states(tmp_path / "scalar.npy", ["x", "y"])


def test_a_column_that_is_named_for_one_role_is_not_guessed_for_another(tmp_path: Path):
    path = plain(tmp_path, position=np.arange(8.0).reshape(4, 2), reward=np.ones(4))
    assert read(path, Layout()).episodes[0].positions.shape == (4, 2)
    (episode,) = read(path, Layout(state=("position", "reward"))).episodes
    assert (episode.states.shape, episode.positions, episode.rewards) == ((4, 3), None, None)


def test_what_is_guessed_by_name_must_look_the_part(tmp_path: Path):
    columns = {
        "position": np.ones((4, 3)),
        "step": np.array([5, 6, 6, 9]),
        "reward": np.ones((4, 2)),
        "score": np.arange(4),
        "tier": np.arange(4),
    }
    path = plain(tmp_path, **columns)
    (episode,) = read(path, Layout()).episodes
    assert (episode.positions, episode.rewards, episode.score, episode.tier) == (None,) * 4
    expected = {
        "position": "expected two columns, x and y, as position",
        "step": "expected step 7 at row 2 of episode 0, found 6",
        "reward": "expected one value per row in column 'reward'",
        "score": "expected one score for episode 0",
        "tier": "expected one tier for episode 0",
    }
    for name, words in expected.items():
        named = (name,) if name == "position" else name
        assert words in refused(path, Layout(**{name: named}))


def test_steps_are_compared_exactly(tmp_path: Path):
    layout = Layout(step="step")
    for first in (20_000_000, 2**60):
        steps = np.arange(first, first + 4)
        assert len(read(plain(tmp_path, step=steps), layout).episodes) == 1
        message = refused(plain(tmp_path, step=steps + np.eye(4, dtype=int)[3]), layout)
        assert f"expected step {first + 3} at row 3 of episode 0, found {first + 4}" in message
    steps = np.array([254, 255, 0, 1], np.uint8)
    assert "expected step 256 at row 2" in refused(plain(tmp_path, step=steps), layout)


def test_a_csv_without_column_names_is_refused(tmp_path: Path):
    message = refused(written(tmp_path / "bare.csv", "1.5,2\n3,4\n"))
    assert "expected a line of column names, found numbers 1.5, 2" in message


def test_integral_episodes_are_integers_in_any_type(tmp_path: Path):
    path = plain(tmp_path, episode=np.array([0.0, 0.0, 1.0, 2.5]))
    for token, expected in (("0", [1, 0, 0]), ("0-1", [1, 1, 0]), ("2.5", [0, 0, 1])):
        found = read(path, Layout(labeled=(token,)))
        assert [e.labeled for e in found.episodes] == expected
    assert found.episodes[0].source == "plain.npz#0"


@pytest.mark.parametrize("token", ["", ",", "nope", "5-9", "9" * 5000 + "-" + "9" * 5000])
def test_labeled_without_an_episode_is_refused(tmp_path: Path, token: str):
    assert f"found {token!r}" in refused(plain(tmp_path), Layout(labeled=(token,)))


def test_an_episode_that_is_not_told_is_refused(tmp_path: Path):
    path = plain(tmp_path, episode=np.array([0, 0, np.nan, 1]))
    assert "expected a value in column 'episode', found nan at row 2" in refused(path, Layout())
    path = plain(tmp_path, episode=np.array([0, 0, 1e300, 1]))
    assert "found 1e+300 at row 2" in refused(path, Layout())


def test_unsigned_integers_that_do_not_fit_are_refused():
    large = np.array([2**63], np.uint64)
    with pytest.raises(InvalidInputError, match="found 9223372036854775808 at row 0"):
        Pairs(np.ones((1, 1)), np.ones((1, 1)), large, np.zeros(1, int))


def test_a_labeled_range_must_begin_and_end_at_an_episode(tmp_path: Path):
    path = npz_file(tmp_path)
    for labeled in ("0-7", "4-8", "9-4"):
        layout = Layout(state=("x",), action=("throttle",), episode="drive", labeled=(labeled,))
        assert f"found '{labeled}'" in refused(path, layout)


def test_the_cell_that_is_no_number_is_named(tmp_path: Path):
    path = written(tmp_path / "t.csv", "x,a\n1,1\n2,1\nabc,1\n")
    message = refused(path, Layout(state=("x",), action=("a",)))
    assert "expected numbers in column 'x', found 'abc' at row 2" in message
