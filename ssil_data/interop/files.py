"""Reading any file: which module does it, by the suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import finite_matrix
from ssil_data.errors import InvalidInputError, NotFoundError
from ssil_data.interop import csv, npz, parquet
from ssil_data.interop.columns import Columns

_READERS: dict[str, Callable[[Path], Columns]] = {
    ".npz": npz.read,
    ".npy": npz.read,
    ".csv": csv.read,
    ".parquet": parquet.read,
}
SUFFIXES = tuple(_READERS)


def read_columns(path: Path) -> Columns:
    """Read the named columns of a file, in any of the formats of `SUFFIXES`.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    NotFoundError
        If there is no such file.
    InvalidInputError
        If it cannot be read.
    """
    if not path.is_file():
        raise NotFoundError(f"file: {path} {'is a folder' if path.is_dir() else 'does not exist'}")
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise InvalidInputError(
            f"{path}: expected a file of type {', '.join(SUFFIXES)}, "
            f"found {path.suffix or 'none'!r}"
        )
    return reader(path)


def read_states(path: Path, names: list[str]) -> NDArray[np.float32]:
    """Read query states for a dataset.

    The columns of the dataset's dimensions are taken, by name; or else `states` or `state`; or
    else all columns.

    Parameters
    ----------
    path
        The file.
    names
        Names of the dataset's d state dimensions.

    Returns
    -------
    NDArray
        States (m, d), finite.

    Raises
    ------
    NotFoundError
        If there is no such file.
    InvalidInputError
        If it cannot be read, or what is taken has not d columns of finite numbers.
    """
    columns = read_columns(path)
    known = columns.names
    if all(name in known for name in names):
        chosen = names
    else:
        chosen = next(([name] for name in ("states", "state") if name in known), known)
    states, _ = columns.matrix(chosen)
    return finite_matrix(f"{path}: {', '.join(chosen[:3])}", states, width=len(names))
