"""NumPy's own files: several arrays by name, or one array. Nothing is ever unpickled."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.interop.columns import Columns, Unreadable
from ssil_data.interop.parsing import refuse_unreadable


def read(path: Path) -> Columns:
    """Read an npz file, or an npy file, whose array is given the name `states`.

    Arrays of Python objects and scalars are left out; using one raises an error that says so.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    InvalidInputError
        If the file is damaged.
    """
    with refuse_unreadable(path, "a NumPy file"), path.open("rb") as file:
        loaded = np.load(file, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return Columns(path, [("states", _decode_text(loaded))])
        return Columns(path, [(name, _member(loaded, name)) for name in loaded.files])


def _member(archive: np.lib.npyio.NpzFile, name: str) -> NDArray[Any] | Unreadable:
    try:
        array: Any = archive[name]
    except ValueError as error:
        if "allow_pickle" not in str(error):
            raise
        return Unreadable("Python objects")
    if not isinstance(array, np.ndarray):
        return Unreadable("a member that is no NumPy array")
    return _decode_text(array)


def _decode_text(array: NDArray[Any]) -> NDArray[Any] | Unreadable:
    try:
        if array.dtype.kind == "S":
            return np.char.decode(array, "utf-8")
        if array.dtype.kind == "U":
            np.char.encode(array, "utf-8")  # what cannot be encoded could not be stored either
    except ValueError:
        return Unreadable("bytes that are not UTF-8 text")
    return array
