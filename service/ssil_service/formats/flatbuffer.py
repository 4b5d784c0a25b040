"""A reader of Arrow's message metadata, of which pyarrow does not show enough.

pyarrow does not say whether a record batch's buffers are compressed before it decompresses them.
This reader finds the two fields that decide how much memory a batch will take: its number of rows
and its compression. Metadata is a flatbuffer, whose tables start with a distance to a list of
offsets ("vtable"), one for each field, 0 for an absent one:
https://flatbuffers.dev/internals/ and https://github.com/apache/arrow/blob/main/format/Message.fbs.

It must survive any bytes: a wrong offset ends in ValueError or struct.error, never elsewhere.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

_MESSAGE_HEADER = 2
"""Place of `header` among the fields of `Message`."""
_BATCH_LENGTH = 0
_BATCH_COMPRESSION = 3
"""Places of `length` and `compression` among the fields of `RecordBatch`."""
_FIRST_OFFSET = 4
"""A vtable begins with two sizes of two bytes each, and goes on with the offsets."""


class BatchHeader(NamedTuple):
    """What a record batch says about itself.

    Attributes
    ----------
    rows
        Rows that it promises; its buffers may hold fewer.
    compressed
        Whether its buffers are compressed.
    """

    rows: int
    compressed: bool


def read_batch_header(metadata: bytes) -> BatchHeader:
    """Read the metadata of one record batch.

    Parameters
    ----------
    metadata
        The flatbuffer of an Arrow `Message` whose header is a `RecordBatch`.

    Returns
    -------
    BatchHeader
        Rows and compression.

    Raises
    ------
    ValueError, struct.error
        For bytes that are no such message.
    """
    root = _FlatTable(metadata, struct.unpack_from("<I", metadata, 0)[0])
    batch = root.table(_MESSAGE_HEADER)
    return BatchHeader(batch.int64(_BATCH_LENGTH), batch.offset(_BATCH_COMPRESSION) != 0)


class _FlatTable:
    """A table of a flatbuffer: where it starts, and where each of its fields does."""

    def __init__(self, data: bytes, start: int) -> None:
        self.data = data
        self.start = start
        self._vtable = start - struct.unpack_from("<i", data, start)[0]
        if self._vtable < 0:  # struct would count it from the end
            raise ValueError("flatbuffer: a vtable before the first byte")
        self._vtable_size = struct.unpack_from("<H", data, self._vtable)[0]

    def offset(self, field: int) -> int:
        """Return where a field starts, counted from the table's start; 0 if it is absent."""
        place = _FIRST_OFFSET + 2 * field
        if place + 2 > self._vtable_size:
            return 0
        return struct.unpack_from("<H", self.data, self._vtable + place)[0]

    def int64(self, field: int) -> int:
        """Return a number of 8 bytes, 0 if it is absent; raises ValueError for a negative one."""
        offset = self.offset(field)
        value = struct.unpack_from("<q", self.data, self.start + offset)[0] if offset else 0
        if value < 0:
            raise ValueError("flatbuffer: a negative length")
        return value

    def table(self, field: int) -> _FlatTable:
        """Return a field that is a table."""
        place = self.start + self.offset(field)
        return _FlatTable(self.data, place + struct.unpack_from("<I", self.data, place)[0])
