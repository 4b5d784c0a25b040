"""Small files of every format that can be imported, and what is refused of them."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ssil_data.errors import InvalidInputError, NotFoundError
from ssil_data.interop import ImportedEpisodes, Layout, import_episodes, read_columns

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
    """Write COLUMNS as CSV."""
    lines = [",".join(COLUMNS)]
    lines += [",".join(str(v[row]) for v in COLUMNS.values()) for row in range(ROWS)]
    return write_text(folder / "drives.csv", "\n".join(lines) + "\n")


def npz_file(folder: Path) -> Path:
    """Write COLUMNS as npz."""
    np.savez(folder / "drives.npz", **COLUMNS)
    return folder / "drives.npz"


def parquet_file(folder: Path) -> Path:
    """Write COLUMNS as Parquet."""
    pq.write_table(pa.table(COLUMNS), folder / "drives.parquet")
    return folder / "drives.parquet"


def write_text(path: Path, text: str) -> Path:
    """Write a text file and return its path."""
    path.write_text(text)
    return path


def read_episodes(path: Path, layout: Layout = LAYOUT) -> ImportedEpisodes:
    """Read a file as episodes."""
    return import_episodes(read_columns(path), layout)


def refuse(path: Path, layout: Layout = LAYOUT) -> str:
    """Return the message with which a file is refused; it names the file."""
    with pytest.raises((InvalidInputError, NotFoundError)) as refusal:
        read_episodes(path, layout)
    assert str(path) in str(refusal.value)
    return str(refusal.value)


def write_npz(folder: Path, **columns: Any) -> Path:
    """Write states and actions of four rows, and these arrays."""
    given = {"states": np.ones((4, 2)), "actions": np.ones((4, 1)), **columns}
    np.savez(folder / "plain.npz", **given)
    return folder / "plain.npz"


def write_parquet(folder: Path, **columns: Any) -> Path:
    """Write state and action of four rows, and these columns, as Parquet."""
    table = {"state": [1.0, 2.0, 3.0, 4.0], "action": [0.0] * 4, **columns}
    pq.write_table(pa.table(table), folder / "plain.parquet")
    return folder / "plain.parquet"


def encode_member(array: np.ndarray, *, header: dict[str, Any] | None = None) -> bytes:
    """Return the bytes of an npy file, with any header."""
    given = header or {"descr": array.dtype.str, "fortran_order": False, "shape": array.shape}
    text = (str(given) + "\n").encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + array.tobytes()
