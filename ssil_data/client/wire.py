"""Arrow on the wire: tables whose lists are matrices, and their bytes; both sides use it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.errors import InvalidInputError

JSON = "application/json"
ARROW = "application/vnd.apache.arrow.stream"
PARQUET = "application/vnd.apache.parquet"

_OPTIONS = pa.ipc.IpcWriteOptions()
"""Made once: pyarrow looks through the environment whenever it makes them."""

IDEMPOTENCY = "Idempotency-Key"
"""Header of a request for a job: two requests with one key make one job."""


def encode(table: pa.Table) -> pa.Buffer:
    """Return a table as an Arrow IPC stream.

    Parameters
    ----------
    table
        Of any columns.
    """
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema, options=_OPTIONS) as stream:
        stream.write_table(table)
    return sink.getvalue()


def decode(body: bytes | pa.Buffer) -> pa.Table:
    """Return the table of an Arrow IPC stream.

    Only for bytes of a service that is trusted: a hostile stream can take any amount of memory.

    Parameters
    ----------
    body
        The stream.

    Raises
    ------
    InvalidInputError
        For bytes that are no such stream.

    Examples
    --------
    >>> import pyarrow as pa
    >>> decode(encode(pa.table({"a": [1, 2]})))["a"].to_pylist()
    [1, 2]
    """
    try:
        return pa.ipc.open_stream(body).read_all()
    except pa.ArrowException as error:
        raise InvalidInputError(f"response: not a readable Arrow stream: {error}") from None


def rows_of_matrix(values: NDArray[Any]) -> pa.FixedSizeListArray:
    """Return a matrix as a column of lists.

    Parameters
    ----------
    values
        (n, w).
    """
    flat = pa.array(np.ascontiguousarray(values).reshape(-1))
    return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def matrix_of_rows(column: pa.ChunkedArray, width: int | None = None) -> NDArray[Any]:
    """Return a column of n lists as a matrix (n, w).

    Parameters
    ----------
    column
        Lists of one length, fixed or not.
    width
        The length that they must have; any without.

    Raises
    ------
    InvalidInputError
        For lists of different lengths, or of another than `width`.
    """
    rows = column.combine_chunks()
    if isinstance(rows.type, pa.FixedSizeListType):
        found = rows.type.list_size
    else:
        lengths = np.unique(rows.value_lengths().to_numpy(zero_copy_only=False))
        if len(lengths) > 1:
            raise InvalidInputError(f"list: expected one width, found {lengths[:2].tolist()}")
        found = int(lengths[0]) if len(lengths) else (width or 0)
    if width is not None and found != width:
        raise InvalidInputError(f"list: expected width {width}, found {found}")
    return rows.flatten().to_numpy(zero_copy_only=False).reshape(len(rows), found)


def states_table(states: NDArray[np.float32]) -> pa.Table:
    """Return states as the body of an LCoR or CoR query.

    Parameters
    ----------
    states
        (m, d) in raw units.
    """
    return pa.table({"state": rows_of_matrix(states)})


def pairs_table(pairs: Pairs) -> pa.Table:
    """Return pairs as a table of episode, step, state and action.

    Parameters
    ----------
    pairs
        In raw units.
    """
    return pa.table(
        {
            "episode": pairs.episode,
            "step": pairs.step,
            "state": rows_of_matrix(pairs.states),
            "action": rows_of_matrix(pairs.actions),
        }
    )


def pairs_of_table(table: pa.Table) -> Pairs:
    """Return the pairs of a table.

    Parameters
    ----------
    table
        As `pairs_table` makes it.
    """
    return Pairs(
        states=matrix_of_rows(table["state"]),
        actions=matrix_of_rows(table["action"]),
        episode=table["episode"].to_numpy(),
        step=table["step"].to_numpy(),
    )
