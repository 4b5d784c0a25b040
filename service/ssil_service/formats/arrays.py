"""Columns of Arrow tables as checked arrays.

A good column is checked as a whole by NumPy; only a bad one is looked through, and no further than
its first hundred faults.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data.demonstrations import finite_matrix
from ssil_data.errors import InvalidInputError
from ssil_service.formats.faults import cell_problem, field_problem, row_problem
from ssil_service.problems import SHOWN


def matrix_from_column(table: pa.Table, name: str, width: int) -> NDArray[Any]:
    """Return a column of lists as a matrix.

    Parameters
    ----------
    table
        A validated table.
    name
        A column of lists of float32 or float64.
    width
        Numbers that each list must have.

    Returns
    -------
    NDArray
        (n, width), of the column's own type, without a copy where that is possible.

    Raises
    ------
    Problem
        422, naming rows without a list, lists of another width, and cells without a number.
    """
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


def integers_from_column(table: pa.Table, name: str) -> NDArray[np.int64]:
    """Return a column of integers as an array.

    Parameters
    ----------
    table
        A validated table.
    name
        A column of int64.

    Returns
    -------
    NDArray
        (n,).

    Raises
    ------
    Problem
        422, naming rows without an integer.
    """
    column = _column(table, name)
    if column.null_count:
        rows = np.flatnonzero(column.is_null().to_numpy(zero_copy_only=False))
        raise row_problem(name, rows, "expected an integer, found none")
    return column.to_numpy()


def check_float32(name: str, values: NDArray[Any], width: int) -> NDArray[np.float32]:
    """Return numbers as float32, every one of them finite.

    Parameters
    ----------
    name
        What the numbers are, for messages.
    values
        (n, width).
    width
        Columns that there must be.

    Returns
    -------
    NDArray
        (n, width).

    Raises
    ------
    Problem
        422, naming the cells that are not finite, or not as float32.
    """
    try:
        return finite_matrix(name, values, width=width)
    except InvalidInputError:
        with np.errstate(over="ignore"):
            bad = ~np.isfinite(np.asarray(values, np.float32))
        raise cell_problem(name, _places(bad.reshape(-1), width)) from None


def _column(table: pa.Table, name: str) -> Any:
    column = table[name]
    return column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()


def _cells(column: Any) -> Any:
    """Return the cells of a column of lists without nulls; uncopied where it is not a slice."""
    if pa.types.is_fixed_size_list(column.type) and not column.offset:
        return column.values[: len(column) * column.type.list_size]
    return column.flatten()


def _places(bad: NDArray[np.bool_], width: int) -> Iterator[tuple[int, int]]:
    """Give row and column of the first bad cells."""
    return (divmod(int(place), width) for place in np.flatnonzero(bad)[:SHOWN])
