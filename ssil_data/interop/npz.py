"""NumPy's own files: arrays by name, or one array. Objects are never unpickled."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.interop.columns import Columns


def read(path: Path) -> Columns:
    """Read the arrays of an npz file, or the one of an npy file under the name `states`.

    Arrays of Python objects and scalars are no columns and are left out.
    """
    try:
        with path.open("rb") as file:
            loaded = np.load(file, allow_pickle=False)
            arrays = {"states": loaded} if isinstance(loaded, np.ndarray) else _members(loaded)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InvalidInputError(f"{path}: expected a NumPy file, found {error}") from None
    return Columns(path, arrays)


def _members(archive: np.lib.npyio.NpzFile) -> dict[str, NDArray[Any]]:
    arrays = {}
    for name in archive.files:
        try:
            array = archive[name]
        except ValueError as error:
            if "allow_pickle" not in str(error):
                raise
            continue
        if array.ndim:
            arrays[name] = array
    return arrays
