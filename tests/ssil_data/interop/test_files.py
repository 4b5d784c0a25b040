"""Any file is read by its suffix, whole or not at all, also as query states."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ssil_data.errors import InvalidInputError
from ssil_data.interop import read_states
from support.foreign_files import (
    npz_file,
    parquet_file,
    refuse,
    write_text,
)


@pytest.mark.parametrize("make", [npz_file, parquet_file])
@pytest.mark.parametrize("kept", [0, 1, 100, 0.5, 0.99])
def test_truncated_files_are_refused(tmp_path: Path, make, kept: float):
    path = make(tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[: int(kept if kept >= 1 else kept * len(data))])
    assert "file" in refuse(path)


def test_states_to_ask_about_are_taken_by_name_or_by_order(tmp_path: Path):
    np.savez(tmp_path / "named.npz", y=[1.0, 2.0], x=[3.0, 4.0], other=[0.0, 0.0])
    np.testing.assert_array_equal(read_states(tmp_path / "named.npz", ["x", "y"]), [[3, 1], [4, 2]])
    np.save(tmp_path / "matrix.npy", np.ones((3, 2)))
    assert read_states(tmp_path / "matrix.npy", ["x", "y"]).shape == (3, 2)
    write_text(tmp_path / "plain.csv", "a,b\n1,2\n3,4\n")
    assert read_states(tmp_path / "plain.csv", ["x", "y"]).shape == (2, 2)
    with pytest.raises(InvalidInputError, match="expected width 3, found 2"):
        read_states(tmp_path / "matrix.npy", ["x", "y", "z"])


@pytest.mark.parametrize(
    ("arrays", "reason"),
    [
        ({"x": np.ones(3), "y": np.ones(4)}, "expected 3 rows in 'y' as in 'x', found 4"),
        ({"x": np.array([{}], dtype=object)}, "expected numbers or text .*, found Python objects"),
        ({"x": np.ones((2, 2, 2))}, "expected one or two dimensions in 'x', found"),
        ({"x": np.ones((3, 0))}, "the file has no rows"),
        ({"x": np.float64(1)}, "expected numbers or text in column 'x', found a scalar"),
        ({"x": np.array(["a", "b"]), "y": np.ones(2)}, "expected numbers in column 'x', found 'a'"),
    ],
)
def test_states_to_ask_about_are_refused_if_they_are_none(
    tmp_path: Path, arrays: dict[str, Any], reason: str
):
    path = tmp_path / "states.npz"
    np.savez(path, **arrays)
    with pytest.raises(InvalidInputError, match=rf"states\.npz: {reason}"):
        read_states(path, ["x", "y"])
    np.save(tmp_path / "scalar.npy", np.float64(1))
    with pytest.raises(InvalidInputError, match="found a scalar"):
        read_states(tmp_path / "scalar.npy", ["x", "y"])
