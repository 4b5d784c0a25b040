"""What is wrong with the numbers of a body, named by field, row and column, a hundred at most."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Any

from numpy.typing import NDArray

from ssil_service.problems import SHOWN, Fault, Problem


def cell_problem(name: str, cells: Iterable[tuple[int, int]]) -> Problem:
    """Return the problem of cells that are no finite float32 numbers.

    Parameters
    ----------
    name
        The field.
    cells
        Rows and columns, of which the first hundred are named; at least one.

    Returns
    -------
    Problem
        With status 422.
    """
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
    """Return the problem of whole rows.

    Parameters
    ----------
    name
        The field.
    rows
        Of which the first hundred are named; at least one.
    detail
        What is wrong with each of them.

    Returns
    -------
    Problem
        With status 422.
    """
    faults = [
        Fault(detail=f"{name}: {detail} at row {row}", field=name, row=int(row))
        for row in rows[:SHOWN]
    ]
    return Problem(422, f"body: {faults[0].detail}", errors=faults)


def field_problem(name: str, detail: str) -> Problem:
    """Return the problem of a field as a whole.

    Parameters
    ----------
    name
        The field.
    detail
        What is wrong with it.

    Returns
    -------
    Problem
        With status 422.
    """
    fault = Fault(detail=f"{name}: {detail}", field=name)
    return Problem(422, f"body: {fault.detail}", errors=[fault])


def refuse_many_rows(name: str, rows: int, most_rows: int) -> None:
    """Refuse a field with too many rows.

    Parameters
    ----------
    name
        The field.
    rows
        Rows that it has.
    most_rows
        Rows that it may have.

    Raises
    ------
    Problem
        With status 413.
    """
    if rows > most_rows:
        raise Problem(413, f"{name}: expected at most {most_rows} rows, found {rows}")
