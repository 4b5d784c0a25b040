"""Whatever a parser raises while it reads a file becomes one error that names the file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ssil_data.errors import InvalidInputError, SsilDataError


@contextmanager
def refuse_unreadable(path: Path, kind: str) -> Iterator[None]:
    """Turn any failure to read a file into InvalidInputError.

    Parsers of damaged files raise what their parts raise: zlib.error, MemoryError, RuntimeError,
    UnicodeDecodeError; a list of them would never be complete.

    Parameters
    ----------
    path
        File being read, or the name of what is read.
    kind
        What it should be, such as "a CSV file".

    Raises
    ------
    InvalidInputError
        For any exception but those of this library, which pass unchanged.
    """
    try:
        yield
    except SsilDataError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InvalidInputError(f"{path}: cannot be read as {kind}: {reason}") from None
