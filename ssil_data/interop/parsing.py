"""Whatever a parser raises over a file's bytes is the file's fault, told in one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ssil_data.errors import InvalidInputError, SsilDataError


@contextmanager
def refuse_unreadable(path: Path, kind: str) -> Iterator[None]:
    """Turn any failure to read `path` as a file of this kind into InvalidInputError.

    Parsers of damaged files raise what their inner workings raise: zlib.error, MemoryError,
    RuntimeError, UnicodeDecodeError; a list of them would never be complete.
    """
    try:
        yield
    except SsilDataError:
        raise
    except Exception as error:
        found = " ".join(str(error).split()) or type(error).__name__
        raise InvalidInputError(f"{path}: expected a {kind} file, found {found}") from None
