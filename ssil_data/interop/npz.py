"""NumPy's own files: arrays by name, or one array. Objects are never unpickled."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from ssil_data.errors import InvalidInputError
from ssil_data.interop.columns import Columns


def read(path: Path) -> Columns:
    """Read the arrays of an npz file, or the one of an npy file under the name `states`.

    Arrays of Python objects and scalars are no columns and are left out.
    """
    try:
        loaded = np.load(path, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return Columns(path, {"states": loaded})
        with loaded:
            arrays = {}
            for name in loaded.files:
                try:
                    array = loaded[name]
                except ValueError as error:
                    if "allow_pickle" not in str(error):
                        raise
                    continue
                if array.ndim:
                    arrays[name] = array
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InvalidInputError(f"{path}: expected a NumPy file, found {error}") from None
    return Columns(path, arrays)
