"""NumPy's own files: arrays by name, or one array. Objects are never unpickled."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.interop.columns import Columns, Unreadable
from ssil_data.interop.parsing import refuse_unreadable


def read(path: Path) -> Columns:
    """Read the arrays of an npz file, or the one of an npy file under the name `states`.

    Arrays of Python objects and scalars are no columns; they are refused when they are asked for.
    """
    with refuse_unreadable(path, "NumPy"), path.open("rb") as file:
        loaded = np.load(file, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return Columns(path, [("states", _text_decoded(loaded))])
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
    return _text_decoded(array)


def _text_decoded(array: NDArray[Any]) -> NDArray[Any] | Unreadable:
    try:
        if array.dtype.kind == "S":
            return np.char.decode(array, "utf-8")
        if array.dtype.kind == "U":
            np.char.encode(array, "utf-8")  # what cannot be encoded could not be stored either
    except ValueError:
        return Unreadable("bytes that are not UTF-8 text")
    return array
