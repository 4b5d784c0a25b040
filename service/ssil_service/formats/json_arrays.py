"""Numbers in JSON as checked arrays, parsed by msgspec.

While the parser runs, it holds Python's interpreter lock and no request is answered: it must be
quick for any body. Rows are therefore decoded as tuples. The garbage collector drops a tuple of
numbers from its books at first sight, but would go through a million lists again and again, which
takes five times as long as parsing them. And what is not decoded as numbers stays bytes
(`msgspec.Raw`): a body of a million empty objects makes no object.

Only a bad body is looked through cell by cell, and no further than its first hundred faults.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import chain, islice
from typing import Any

import numpy as np
from msgspec import DecodeError, Raw, ValidationError
from msgspec.json import Decoder
from numpy.typing import NDArray
from pydantic import BaseModel

from ssil_service.formats.arrays import check_float32
from ssil_service.formats.faults import (
    cell_problem,
    field_problem,
    refuse_many_rows,
    row_problem,
)
from ssil_service.problems import SHOWN, Fault, Problem

_MOST = float(np.finfo(np.float32).max)
_INT64 = range(-(2**63), 2**63)
_OBJECT = Decoder(dict[str, Raw])
_LIST = Decoder(list[Raw])
_INTEGERS = Decoder(list[int])
_NUMBER = Decoder(int | float)


def read_object(body: bytes, model: type[BaseModel]) -> dict[str, Raw]:
    """Return the fields of a JSON object, each of them still JSON.

    Parameters
    ----------
    body
        JSON.
    model
        Says which fields the object may and must have.

    Returns
    -------
    dict
        The fields that are there.

    Raises
    ------
    Problem
        422 for what is no JSON object, and naming fields that are missing or unknown.
    """
    try:
        fields = _OBJECT.decode(body)
    except ValidationError:
        raise Problem(422, "body: not a JSON object") from None
    except (DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise invalid_json(error) from None
    faults = [
        Fault(detail=f"{name}: Field required", field=name)
        for name, known in model.model_fields.items()
        if known.is_required() and name not in fields
    ]
    unknown = (name[:100] for name in fields if name not in model.model_fields)
    faults += [
        Fault(detail=f"{name}: Extra inputs are not permitted", field=name)
        for name in islice(unknown, SHOWN - len(faults))
    ]
    if faults:
        raise Problem(422, f"body: {faults[0].detail}", errors=faults)
    return fields


def invalid_json(error: Exception) -> Problem:
    """Return the problem of bytes that are no JSON.

    Parameters
    ----------
    error
        What msgspec raised; its text names the place and quotes nothing of the body.

    Returns
    -------
    Problem
        With status 422.
    """
    reason = str(error) if isinstance(error, DecodeError) else type(error).__name__
    return Problem(422, f"body: Invalid JSON: {reason}")


def is_null(value: Raw) -> bool:
    """Tell whether a value is JSON's null.

    Parameters
    ----------
    value
        JSON.

    Returns
    -------
    bool
        True for null.
    """
    return len(memoryview(value)) == 4 and bytes(value) == b"null"


def matrix_from_json(name: str, value: Raw, width: int, *, most_rows: int) -> NDArray[np.float32]:
    """Return a JSON list of rows as a matrix.

    Parameters
    ----------
    name
        The field.
    value
        JSON: a list of lists of numbers.
    width
        Numbers that each row must have.
    most_rows
        Rows that there may be.

    Returns
    -------
    NDArray
        (n, width).

    Raises
    ------
    Problem
        413 for too many rows; 422, naming rows that are no lists or of another width, or else
        cells that are no finite float32 numbers.
    """
    try:
        rows = _rows_decoder(width).decode(value)
    except (DecodeError, RecursionError) as error:
        raise _explain_matrix(name, value, width, most_rows, error) from None
    refuse_many_rows(name, len(rows), most_rows)
    flat = np.fromiter(chain.from_iterable(rows), np.float64, len(rows) * width)
    return check_float32(name, flat.reshape(len(rows), width), width)


def integers_from_json(name: str, value: Raw) -> NDArray[np.int64]:
    """Return a JSON list of integers as an array; 3.0 is one.

    Parameters
    ----------
    name
        The field.
    value
        JSON: a list of integers.

    Returns
    -------
    NDArray
        (n,).

    Raises
    ------
    Problem
        422, naming rows that are no integers of 64 bits.
    """
    try:
        return np.array(_INTEGERS.decode(value), np.int64)
    except (DecodeError, RecursionError, OverflowError):
        pass  # looked through below
    cells = _list(value)
    if cells is None:
        raise field_problem(name, "expected a list of integers, found another value")
    odd = list(islice((row for row, cell in enumerate(cells) if _int64(cell) is None), SHOWN))
    if odd:
        raise row_problem(name, odd, "expected an integer of 64 bits")
    return np.array([_int64(cell) for cell in cells], np.int64)


@lru_cache(64)
def _rows_decoder(width: int) -> Decoder[list[tuple[float, ...]]]:
    """Return the decoder of a list of rows, each of exactly so many numbers."""
    row: Any = tuple[(float,) * width]
    return Decoder(list[row])


@lru_cache(64)
def _row_decoder(width: int) -> Decoder[tuple[float, ...]]:
    row: Any = tuple[(float,) * width]
    return Decoder(row)


def _explain_matrix(name: str, value: Raw, width: int, most_rows: int, error: Exception) -> Problem:
    """Return what is wrong with a list of rows that could not be decoded as one of numbers."""
    rows = _list(value)
    if rows is None:
        return field_problem(name, "expected a list of rows, found another value")
    refuse_many_rows(name, len(rows), most_rows)
    odd_rows: list[int] = []
    odd_cells: list[tuple[int, int]] = []
    for row, cells in _bad_rows(rows, width):
        if cells is None or len(cells) != width:
            odd_rows.append(row)
        elif not odd_rows and len(odd_cells) < SHOWN:
            odd_cells += [(row, c) for c, cell in enumerate(cells) if not _is_float32(cell)]
        if len(odd_rows) == SHOWN:
            break
    if odd_rows:
        first = _list(rows[odd_rows[0]])
        found = "no list" if first is None else len(first)
        return row_problem(name, odd_rows, f"expected width {width}, found {found}")
    return cell_problem(name, odd_cells) if odd_cells else invalid_json(error)


def _bad_rows(rows: list[Raw], width: int) -> Iterator[tuple[int, list[Raw] | None]]:
    """Give the rows that are not so many float32 numbers, with their cells; None for no list."""
    decoder = _row_decoder(width)
    for row, value in enumerate(rows):
        try:
            if max(map(abs, decoder.decode(value)), default=0.0) <= _MOST:
                continue
        except (DecodeError, RecursionError):
            pass
        yield row, _list(value)


def _list(value: Raw) -> list[Raw] | None:
    """Return the members of a JSON list, each still JSON; None for another value."""
    try:
        return _LIST.decode(value)
    except (DecodeError, RecursionError):
        return None


def _number(cell: Raw) -> Any:
    """Return a JSON number, None for another value or one beyond float64."""
    try:
        return _NUMBER.decode(cell)
    except (DecodeError, RecursionError):
        return None


def _is_float32(cell: Raw) -> bool:
    number = _number(cell)
    return number is not None and abs(number) <= _MOST


def _int64(cell: Raw) -> int | None:
    """Return a JSON integer of 64 bits, None for another value."""
    number = _number(cell)
    if isinstance(number, float):
        number = int(number) if number.is_integer() else None
    return number if number is not None and number in _INT64 else None
