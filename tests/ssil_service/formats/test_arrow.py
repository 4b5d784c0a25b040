"""Arrow streams: their metadata is read as Arrow reads it, and any bytes are survived."""

import struct

import numpy as np
import pyarrow as pa
import pytest

from ssil_data.client.wire import encode, rows_of_matrix
from ssil_service.formats.arrow import MOST_BATCHES, read_stream
from ssil_service.formats.flatbuffer import read_batch_header
from ssil_service.problems import Problem

ROWS = 201


@pytest.fixture(scope="module")
def table() -> pa.Table:
    states = np.random.default_rng(0).normal(size=(ROWS, 3)).astype(np.float32)
    names = pa.array([f"{row}" for row in range(ROWS)])
    return pa.table({"state": rows_of_matrix(states), "name": names})


def stream(table: pa.Table, codec: str | None = None, most_rows: int | None = None) -> bytes:
    sink = pa.BufferOutputStream()
    options = pa.ipc.IpcWriteOptions(compression=codec)
    with pa.ipc.new_stream(sink, table.schema, options=options) as writer:
        writer.write_table(table, most_rows)
    return sink.getvalue().to_pybytes()


def batch_metadata(body: bytes) -> list[bytes]:
    messages = list(pa.ipc.MessageReader.open_stream(pa.py_buffer(body)))
    return [m.metadata.to_pybytes() for m in messages if m.type == "record batch"]


def read(body: bytes, most_rows: int = 1000) -> pa.Table:
    return read_stream(body, most_rows=most_rows, check=lambda schema: None)


@pytest.mark.parametrize("codec", [None, "lz4", "zstd"])
@pytest.mark.parametrize("most_rows", [None, 1, 50])
def test_rows_and_compression_are_those_that_were_written(
    table: pa.Table, codec: str | None, most_rows: int | None
):
    headers = [read_batch_header(m) for m in batch_metadata(stream(table, codec, most_rows))]
    assert [header.rows for header in headers] == [
        batch.num_rows for batch in table.to_batches(most_rows)
    ]
    assert {header.compressed for header in headers} == {codec is not None}


def test_a_good_stream_is_the_table(table: pa.Table):
    assert read(encode(table).to_pybytes()).equals(table)
    dictionary = pa.table({"name": table["name"].dictionary_encode()})
    assert read(stream(dictionary)).equals(dictionary)


def test_a_promise_of_too_many_rows_is_refused_before_they_are_made(table: pa.Table):
    body = stream(table)
    assert body.count(struct.pack("<q", ROWS)) >= 1
    for rows, status in ((2**40, 413), (2**62, 413), (-1, 422)):
        lie = body.replace(struct.pack("<q", ROWS), struct.pack("<q", rows))
        with pytest.raises(Problem) as raised:
            read(lie)
        assert raised.value.status == status


def test_compressed_buffers_and_too_many_batches_are_refused(table: pa.Table):
    with pytest.raises(Problem, match="compressed") as raised:
        read(stream(table, "zstd"))
    assert raised.value.status == 415
    empty = table.slice(0, 0).to_batches() or [pa.RecordBatch.from_pylist([], table.schema)]
    many = pa.BufferOutputStream()
    with pa.ipc.new_stream(many, table.schema) as writer:
        for _ in range(MOST_BATCHES + 1):
            writer.write_batch(empty[0])
    with pytest.raises(Problem) as raised:
        read(many.getvalue().to_pybytes())
    assert raised.value.status == 413


def test_any_metadata_is_a_header_or_a_value_error(table: pa.Table):
    """Every byte of good metadata becomes another one, and every length is cut."""
    (metadata,) = batch_metadata(stream(table))
    good = read_batch_header(metadata)
    refused = changed = 0
    spoiled = [
        metadata[:place] + bytes([byte]) + metadata[place + 1 :]
        for place in range(len(metadata))
        for byte in {0, 1, 0x7F, 0x80, 0xFF, metadata[place] ^ 1}
    ]
    for data in [*spoiled, *(metadata[:length] for length in range(len(metadata)))]:
        try:
            header = read_batch_header(data)
        except (ValueError, struct.error):
            refused += 1
        else:
            assert header.rows >= 0
            changed += header != good
    assert refused > 100 and changed > 10


def test_any_spoiled_stream_is_refused_or_within_its_limits(table: pa.Table):
    body = stream(table, most_rows=100)
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(2000):
        data = bytearray(body)
        for place in rng.integers(0, len(data), rng.integers(1, 4)):
            data[place] = rng.integers(0, 256)
        try:
            found = read(bytes(data))
        except Problem as problem:
            assert problem.status in (413, 415, 422)
            refused += 1
        else:
            assert found.num_rows <= 1000
    assert 20 < refused < 2000
