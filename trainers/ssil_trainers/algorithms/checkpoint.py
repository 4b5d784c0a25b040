"""Arrays with a JSON description in one safetensors file, written whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from ssil_data.errors import DamagedError, InvalidInputError, NotFoundError

_KEY = "ssil"


def write(path: Path, arrays: Mapping[str, NDArray[Any]], described: Mapping[str, Any]) -> None:
    """Write arrays and what they are; the file has its old contents or its new ones, never half.

    Same arrays, same description, same bytes. The description must be JSON without NaN.
    """
    text = json.dumps(described, sort_keys=True, allow_nan=False)
    plain = {name: np.array(array, order="C") for name, array in arrays.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    with draft.open("wb") as file:
        file.write(save(plain, metadata={_KEY: text}))
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)


def read(path: Path, kind: str) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Read arrays and their description, whose `kind` must be the one expected.

    Nothing in the file is executed. Raises NotFoundError, DamagedError, or InvalidInputError for
    a file of another kind.
    """
    if not path.is_file():
        raise NotFoundError(f"{kind}: expected a file, found none at {path}")
    data = path.read_bytes()
    try:
        arrays = load(data)
        length = int.from_bytes(data[:8], "little")
        described = json.loads(json.loads(data[8 : 8 + length])["__metadata__"][_KEY])
        found = described["kind"]
    except (SafetensorError, KeyError, TypeError, ValueError) as error:
        raise DamagedError(f"{path}: expected safetensors with a description: {error}") from None
    if found != kind:
        raise InvalidInputError(f"{path}: expected a {kind}, found a {found}")
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise DamagedError(f"{path}: expected finite numbers in {name}, found otherwise")
    return arrays, described
