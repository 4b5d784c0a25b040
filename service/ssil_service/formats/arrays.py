"""Numbers of bodies, as arrays: what is wrong is named by row and column, a hundred at most.

Good bodies are checked whole, by NumPy; only a bad one is looked through cell by cell, and no
further than its first hundred faults.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, islice
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data.demonstrations import finite_matrix
from ssil_data.errors import InvalidInputError
from ssil_service.problems import SHOWN, Fault, Problem

_NUMBERS = {int, float}
_MOST = float(np.finfo(np.float32).max)
_INT64 = range(-(2**63), 2**63)


def rows_from_json(name: str, rows: Any, width: int) -> NDArray[np.float32]:
    """Return JSON's lists of numbers as (n, width); raises a Problem naming odd rows and cells."""
    if type(rows) is not list:
        raise field_problem(name, "expected a list of rows, found another value")
    odd = [row for row, cells in enumerate(rows) if type(cells) is not list or len(cells) != width]
    if odd:
        first = rows[odd[0]]
        found = len(first) if type(first) is list else "no list"
        raise row_problem(name, odd, f"expected width {width}, found {found}")
    if set(map(type, chain.from_iterable(rows))) <= _NUMBERS:
        try:
            return check_float32(name, np.array(rows, np.float64).reshape(len(rows), width), width)
        except OverflowError:
            pass  # an integer beyond float64: found below
    cells = ((r, c, value) for r, row in enumerate(rows) for c, value in enumerate(row))
    raise cell_problem(name, ((r, c) for r, c, value in cells if not _is_float32(value)))


def integers_from_json(name: str, values: Any) -> NDArray[np.int64]:
    """Return JSON's list of integers as (n,); 3.0 is one. Raises a Problem naming odd rows."""
    if type(values) is not list:
        raise field_problem(name, "expected a list of integers, found another value")
    if not set(map(type, values)) <= {int} or any(value not in _INT64 for value in values):
        odd = (row for row, value in enumerate(values) if not _is_int64(value))
        some = list(islice(odd, SHOWN))
        if some:
            raise row_problem(name, some, "expected an integer of 64 bits")
        values = [int(value) for value in values]
    return np.array(values, np.int64)


def _is_float32(value: Any) -> bool:
    return type(value) in _NUMBERS and abs(value) <= _MOST


def _is_int64(value: Any) -> bool:
    whole = type(value) is int or (type(value) is float and value.is_integer())
    return whole and int(value) in _INT64


def _column(table: pa.Table, name: str) -> Any:
    column = table[name]
    return column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()


def matrix_from_column(table: pa.Table, name: str, width: int) -> NDArray[Any]:
    """Return a validated column of lists as (n, width); raises a Problem naming odd rows."""
    column = _column(table, name)
    if column.null_count:
        rows = np.flatnonzero(column.is_null().to_numpy(zero_copy_only=False))
        raise row_problem(name, rows, "expected a list, found none")
    if not pa.types.is_fixed_size_list(column.type):
        lengths = column.value_lengths().to_numpy(zero_copy_only=False)
        odd = np.flatnonzero(lengths != width)
        if len(odd):
            raise row_problem(name, odd, f"expected width {width}, found {lengths[odd[0]]}")
    elif column.type.list_size != width:
        raise field_problem(name, f"expected width {width}, found {column.type.list_size}")
    cells = _cells(column)
    if cells.null_count:
        raise cell_problem(name, _places(cells.is_null().to_numpy(zero_copy_only=False), width))
    return cells.to_numpy(zero_copy_only=False).reshape(len(column), width)


def _cells(column: Any) -> Any:
    """Return the cells of a column without nulls; those of one that is whole are simply there."""
    if pa.types.is_fixed_size_list(column.type) and not column.offset:
        return column.values[: len(column) * column.type.list_size]
    return column.flatten()


def integers_from_column(table: pa.Table, name: str) -> NDArray[np.int64]:
    """Return a column of integers as (n,); raises a Problem naming rows without one."""
    column = _column(table, name)
    if column.null_count:
        rows = np.flatnonzero(column.is_null().to_numpy(zero_copy_only=False))
        raise row_problem(name, rows, "expected an integer, found none")
    return column.to_numpy()


def check_float32(name: str, values: NDArray[Any], width: int) -> NDArray[np.float32]:
    """Return finite float32 numbers (n, width); raises a Problem naming every other cell."""
    try:
        return finite_matrix(name, values, width=width)
    except InvalidInputError:
        with np.errstate(over="ignore"):
            bad = ~np.isfinite(np.asarray(values, np.float32))
        raise cell_problem(name, _places(bad.reshape(-1), width)) from None


def _places(bad: NDArray[np.bool_], width: int) -> Iterator[tuple[int, int]]:
    return (divmod(int(place), width) for place in np.flatnonzero(bad)[:SHOWN])


def cell_problem(name: str, cells: Iterable[tuple[int, int]]) -> Problem:
    """Return the problem of numbers that are none at these rows and columns."""
    faults = [
        Fault(
            detail=f"{name}: expected a finite float32 number at row {row}, column {column}",
            field=name,
            row=row,
            column=column,
        )
        for row, column in islice(cells, SHOWN)
    ]
    return Problem(422, f"body: {faults[0].detail}", errors=faults)


def row_problem(name: str, rows: Sequence[int] | NDArray[Any], detail: str) -> Problem:
    """Return the problem of these rows."""
    faults = [
        Fault(detail=f"{name}: {detail} at row {row}", field=name, row=int(row))
        for row in rows[:SHOWN]
    ]
    return Problem(422, f"body: {faults[0].detail}", errors=faults)


def field_problem(name: str, detail: str) -> Problem:
    """Return the problem of a field as a whole."""
    fault = Fault(detail=f"{name}: {detail}", field=name)
    return Problem(422, f"body: {fault.detail}", errors=[fault])
