"""Arrow streams from strangers: nothing is decompressed, decoded or used before it is checked.

A record batch's metadata is read by hand first: pyarrow does not tell whether its buffers are
compressed, and a few bytes of it may promise any number of rows.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator

import pyarrow as pa

from ssil_service.problems import Problem

MOST_BATCHES = 4096
"""Record batches of one stream at most: each costs some, however few rows it has."""
_HEADER, _ROWS, _COMPRESSION = 2, 0, 3


def read_stream(
    body: bytes | pa.Buffer, *, most_rows: int, check: Callable[[pa.Schema], None]
) -> pa.Table:
    """Return the table of an Arrow IPC stream; its buffers are the body's.

    `check` sees the schema before any row is read. Raises a Problem: 422 for what is no such
    stream, 413 for too many rows, 415 for compressed buffers.
    """
    try:
        buffer = pa.py_buffer(body)
        messages = iter(pa.ipc.MessageReader.open_stream(buffer))
        first = next(messages)
        if first.type != "schema":  # pyarrow would read it as one, and die
            raise ValueError("stream")
        schema = pa.ipc.read_schema(first)
        check(schema)
        plain = _refuse_bombs(messages, most_rows)
        if plain is None:  # dictionaries, which only a reader of the whole stream resolves
            batches = list(pa.ipc.open_stream(buffer))
        else:
            batches = [pa.ipc.read_record_batch(message, schema) for message in plain]
        for batch in batches:
            batch.validate(full=True)
        return pa.Table.from_batches(batches, schema)
    except Problem:
        raise
    except (
        pa.ArrowException,
        OSError,
        ValueError,
        TypeError,
        StopIteration,
        struct.error,
    ) as error:
        raise not_readable("an Arrow IPC stream", error) from None


def not_readable(kind: str, error: Exception) -> Problem:
    """Return the problem of a body that is not what its type says; the parser's own words stay."""
    return Problem(
        422, f"body: expected {kind}, found bytes that are none ({type(error).__name__})"
    )


def _refuse_bombs(messages: Iterator[pa.Message], most_rows: int) -> list[pa.Message] | None:
    """Return the record batches, None if there are other messages; raises a Problem for bombs."""
    rows, batches, plain = 0, list[pa.Message](), True
    for message in messages:
        if message.type != "record batch":
            plain = False
            continue
        batch = _table(message.metadata.to_pybytes())
        if batch.slot(_COMPRESSION):
            raise Problem(415, "body: expected uncompressed Arrow buffers, found compressed ones")
        rows += batch.int64(_ROWS)
        batches.append(message)
        if rows > most_rows or len(batches) > MOST_BATCHES:
            raise Problem(
                413,
                f"body: expected at most {most_rows} rows in {MOST_BATCHES} batches, found more",
            )
    return batches if plain else None


class _FlatTable:
    """A table of a flatbuffer: where it lies, and where each of its fields does."""

    def __init__(self, data: bytes, place: int) -> None:
        self.data, self.place = data, place
        self._vtable = place - struct.unpack_from("<i", data, place)[0]
        if self._vtable < 0:
            raise ValueError("flatbuffer")
        self._size = struct.unpack_from("<H", data, self._vtable)[0]

    def slot(self, number: int) -> int:
        """Return where a field lies from the table's place, 0 if it is absent."""
        at = 4 + 2 * number
        if at + 2 > self._size:
            return 0
        return struct.unpack_from("<H", self.data, self._vtable + at)[0]

    def int64(self, number: int) -> int:
        """Return a field of 8 bytes; raises ValueError for a negative one."""
        slot = self.slot(number)
        value = struct.unpack_from("<q", self.data, self.place + slot)[0] if slot else 0
        if value < 0:
            raise ValueError("flatbuffer")
        return value

    def table(self, number: int) -> _FlatTable:
        """Return a field that is a table."""
        place = self.place + self.slot(number)
        return _FlatTable(self.data, place + struct.unpack_from("<I", self.data, place)[0])


def _table(metadata: bytes) -> _FlatTable:
    root = _FlatTable(metadata, struct.unpack_from("<I", metadata, 0)[0])
    return root.table(_HEADER)
