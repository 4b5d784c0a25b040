"""Arrays and a JSON description in one safetensors file, written completely or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from ssil_data.errors import DamagedError, InvalidInputError, NotFoundError

_KEY = "ssil"
"""Key of the description in the header of the safetensors file."""


def write(path: Path, arrays: Mapping[str, NDArray[Any]], metadata: Mapping[str, Any]) -> None:
    """Write arrays with their description; a crash leaves the old file or the new one, never half.

    The same arrays and description give the same bytes.

    Parameters
    ----------
    path:
        The file; its folder is made if it is missing.
    arrays:
        Arrays by name.
    metadata:
        JSON without NaN. `kind` says what the file is; `read` demands it.

    Raises
    ------
    ValueError
        For a description that JSON cannot hold; nothing is written.

    Examples
    --------
    >>> write(Path("numbers.safetensors"), {"a": np.arange(3)}, {"kind": "numbers"})
    >>> arrays, metadata = read(Path("numbers.safetensors"), "numbers")
    >>> arrays["a"].tolist(), metadata
    ([0, 1, 2], {'kind': 'numbers'})
    """
    text = json.dumps(metadata, sort_keys=True, allow_nan=False)
    contiguous = {name: np.array(array, order="C") for name, array in arrays.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    with draft.open("wb") as file:
        file.write(save(contiguous, metadata={_KEY: text}))
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)


def read(path: Path, kind: str) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Read the arrays and the description of a file; nothing in it is executed.

    Parameters
    ----------
    path:
        The file that `write` wrote.
    kind:
        What it must be.

    Returns
    -------
    :
        Arrays by name, and the description.

    Raises
    ------
    NotFoundError
        If there is no such file.
    DamagedError
        If it is not such a file, was cut off, or has numbers that are not finite.
    InvalidInputError
        If it is of another kind.

    Examples
    --------
    >>> read(Path("missing.safetensors"), "ssil policy")
    Traceback (most recent call last):
    ssil_data.errors.NotFoundError: ssil policy: no file at missing.safetensors
    """
    if not path.is_file():
        raise NotFoundError(f"{kind}: no file at {path}")
    try:
        with safe_open(path, framework="numpy") as file:
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            metadata = json.loads((file.metadata() or {})[_KEY])
        found = metadata["kind"]
    except (SafetensorError, KeyError, TypeError, ValueError) as error:
        raise DamagedError(
            f"{path}: not a safetensors file with a description of its arrays: {error}"
        ) from None
    if found != kind:
        raise InvalidInputError(f"{path}: expected a {kind}, found a {found}")
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise DamagedError(f"{path}: the array {name} has numbers that are not finite")
    return arrays, metadata
