"""Columns are found by name, have equally many rows and finite numbers."""

import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ssil_data.errors import InvalidInputError
from ssil_data.interop import Layout, read_states
from support.foreign_files import (
    COLUMNS,
    ROWS,
    csv_file,
    encode_member,
    npz_file,
    parquet_file,
    refuse,
    write_npz,
    write_text,
)


@pytest.mark.parametrize("make", [csv_file, npz_file, parquet_file])
def test_an_unknown_column_is_refused_with_the_known_ones(tmp_path: Path, make):
    message = refuse(make(tmp_path), Layout(state=("z",), action=("throttle",)))
    assert "found 'z'" in message
    assert "'throttle'" in message


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_what_is_not_a_finite_float32_is_refused_with_row_and_column(tmp_path: Path, value: float):
    columns = {**COLUMNS, "x": np.where(np.arange(ROWS) == 5, value, COLUMNS["x"])}
    np.savez(tmp_path / "bad.npz", **columns)
    pq.write_table(pa.table(columns), tmp_path / "bad.parquet")
    lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values()))]  # noqa: B905
    write_text(tmp_path / "bad.csv", "\n".join(lines))
    for suffix in ("npz", "parquet", "csv"):
        message = refuse(tmp_path / f"bad.{suffix}")
        assert f"found {value} at row 5, column 'x'" in message


@pytest.mark.parametrize(
    "name", ["actions", "episode", "step", "reward", "position", "score", "tier", "labeled"]
)
def test_every_used_column_has_the_rows_of_the_states(tmp_path: Path, name: str):
    wide = {"actions": (5, 1), "position": (5, 2)}
    path = write_npz(tmp_path, **{name: np.ones(wide.get(name, 5))})
    layout = Layout(step="step") if name == "step" else Layout()
    assert f"expected 4 rows in '{name}' as in 'states', found 5" in refuse(path, layout)


def test_columns_of_one_name_are_refused(tmp_path: Path):
    expected = "two columns have the name 'x'; rename one"
    path = write_text(tmp_path / "twice.csv", "x,x\n1,2\n")
    assert expected in refuse(path, Layout(state=("x",), action=("x",)))
    table = pa.Table.from_arrays([pa.array([1.0]), pa.array([2.0])], names=["x", "x"])
    pq.write_table(table, tmp_path / "twice.parquet")
    layout = Layout(state=("x",), action=("x",))
    assert expected in refuse(tmp_path / "twice.parquet", layout)
    member = encode_member(np.ones(2))
    with (
        pytest.warns(UserWarning, match="Duplicate"),
        zipfile.ZipFile(tmp_path / "twice.npz", "w") as archive,
    ):
        archive.writestr("x.npy", member)
        archive.writestr("x.npy", member)
    assert expected in refuse(tmp_path / "twice.npz", layout)


def test_files_without_rows_are_refused(tmp_path: Path):
    expected = "the file has no rows"
    assert expected in refuse(write_text(tmp_path / "none.csv", "state,action\n"), Layout())
    np.savez(tmp_path / "none.npz", states=np.ones((0, 2)), actions=np.ones((0, 1)))
    assert expected in refuse(tmp_path / "none.npz", Layout())
    lists = pa.array([], pa.list_(pa.float32()))
    pq.write_table(pa.table({"state": lists, "action": lists}), tmp_path / "none.parquet")
    assert expected in refuse(tmp_path / "none.parquet", Layout())
    for name in ("none.csv", "none.npz", "none.parquet"):
        with pytest.raises(InvalidInputError, match=expected):
            read_states(tmp_path / name, ["x", "y"])


def test_files_without_columns_are_refused(tmp_path: Path):
    pq.write_table(pa.table({}), tmp_path / "none.parquet")
    np.savez(tmp_path / "none.npz")
    for name in ("none.parquet", "none.npz"):
        assert "the file has no columns" in refuse(tmp_path / name, Layout())
