"""Arrow IPC streams from clients, checked before anything is decompressed, decoded or used.

A few bytes of metadata may promise any number of rows, and compressed buffers may grow to any size:
every record batch's metadata is read first (`flatbuffer`).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator

import pyarrow as pa

from ssil_service.formats.flatbuffer import read_batch_header
from ssil_service.problems import Problem

MOST_BATCHES = 4096
"""Record batches that one stream may have: each costs some time, however few rows it has."""


def read_stream(
    body: bytes | pa.Buffer, *, most_rows: int, check: Callable[[pa.Schema], None]
) -> pa.Table:
    """Read an Arrow IPC stream.

    Parameters
    ----------
    body
        The stream.
    most_rows
        Rows that it may have.
    check
        Called with the schema before any row is read; raises a Problem for one to be refused.

    Returns
    -------
    pa.Table
        The table; its buffers are the body's, not copies.

    Raises
    ------
    Problem
        422 for bytes that are no Arrow IPC stream, 413 for too many rows or batches, 415 for
        compressed buffers.
    """
    try:
        buffer = pa.py_buffer(body)
        messages = iter(pa.ipc.MessageReader.open_stream(buffer))
        first = next(messages)
        if first.type != "schema":  # pyarrow would read it as one, and crash
            raise ValueError("a stream that does not begin with a schema")
        schema = pa.ipc.read_schema(first)
        check(schema)
        batch_messages = _refuse_bombs(messages, most_rows)
        if batch_messages is None:
            batches = list(pa.ipc.open_stream(buffer))
        else:
            batches = [pa.ipc.read_record_batch(message, schema) for message in batch_messages]
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
        raise unreadable("an Arrow IPC stream", error) from None


def unreadable(kind: str, error: Exception) -> Problem:
    """Return the problem of a body that is not what its media type says.

    Parameters
    ----------
    kind
        What it should be, with an article.
    error
        What its parser raised; only the error's type is shown, as its text may quote the body.

    Returns
    -------
    Problem
        With status 422.
    """
    return Problem(422, f"body: not {kind} ({type(error).__name__})")


def _refuse_bombs(messages: Iterator[pa.Message], most_rows: int) -> list[pa.Message] | None:
    """Return the record batches; raises a Problem if they would take more than they may.

    None if there are dictionaries among them, which only pyarrow's reader of a whole stream
    resolves.
    """
    rows = 0
    batches: list[pa.Message] = []
    only_batches = True
    for message in messages:
        if message.type != "record batch":
            only_batches = False
            continue
        header = read_batch_header(message.metadata.to_pybytes())
        if header.compressed:
            raise Problem(415, "body: compressed Arrow buffers are not accepted")
        rows += header.rows
        batches.append(message)
        if rows > most_rows or len(batches) > MOST_BATCHES:
            raise Problem(413, f"body: more than {most_rows} rows or {MOST_BATCHES} batches")
    return batches if only_batches else None
