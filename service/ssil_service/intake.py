"""What clients send, as arrays: JSON, Arrow or Parquet, checked before anything is computed."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
from fastapi import Request
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError

from ssil_data.client.wire import ARROW, JSON, PARQUET
from ssil_data.demonstrations import Pairs, finite_matrix
from ssil_data.errors import InvalidInputError
from ssil_service.context import context
from ssil_service.problems import Fault, Problem, of_validation
from ssil_service.schemas import PairsBody, StatesBody
from ssil_service.streams import read_stream

Model = TypeVar("Model", bound=BaseModel)
_INLINE = 2**20
_LISTED = 100
_LISTS = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)


async def json_body(request: Request, model: type[Model]) -> Model:
    """Return the JSON body as a model; raises a Problem that names every offending place."""
    media_type(request, (JSON,))
    return parsed(await request.body(), model)


def parsed(body: bytes, model: type[Model]) -> Model:
    """Return bytes as a model; raises a Problem that names every offending place."""
    try:
        return model.model_validate_json(body)
    except ValidationError as error:
        found = error.errors(include_url=False, include_context=False, include_input=False)
        raise of_validation(found, "body") from None


async def states_body(request: Request, width: int) -> NDArray[np.float32]:
    """Return the states (m, d) of a question."""
    if media_type(request) == JSON:
        body = await _of_json(request, StatesBody)
        return checked("states", ragged("states", body.states, width), width)
    table = await _table(request, "state")
    return checked("state", column_matrix(table, "state", width), width)


async def pairs_body(request: Request, widths: tuple[int, int]) -> Pairs:
    """Return the pairs of a question; without episode and step they are one episode."""
    if media_type(request) == JSON:
        body = await _of_json(request, PairsBody)
        states = ragged("states", body.states, widths[0])
        actions = ragged("actions", body.actions, widths[1])
        place = {"episode": body.episode, "step": body.step}
    else:
        table = await _table(request, "state", "action")
        states = column_matrix(table, "state", widths[0])
        actions = column_matrix(table, "action", widths[1])
        place = {n: _integers(table, n) if n in table.column_names else None for n in _PLACE}
    count = len(states)
    episode = np.zeros(count, np.int64) if place["episode"] is None else place["episode"]
    step = counted(np.asarray(episode)) if place["step"] is None else place["step"]
    return Pairs(
        states=checked("states", states, widths[0]),
        actions=checked("actions", actions, widths[1]),
        episode=np.asarray(episode, np.int64),
        step=np.asarray(step, np.int64),
    )


_PLACE = ("episode", "step")
_COLUMNS = ("state", "action", *_PLACE)


def media_type(request: Request, offered: Sequence[str] = (JSON, ARROW, PARQUET)) -> str:
    """Return the body's media type; raises a Problem with 415 for another, or any coding."""
    if request.headers.get("content-encoding", "identity").lower() != "identity":
        raise Problem(415, "Content-Encoding: expected none, found one")
    given = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if given not in offered:
        raise Problem(415, f"Content-Type: expected one of {', '.join(offered)}, found another")
    return given


async def off_loop(body_size: int, work: Callable[[], Any]) -> Any:
    """Do small work here and now, large work in a thread."""
    return work() if body_size <= _INLINE else await asyncio.to_thread(work)


async def _of_json(request: Request, model: type[Model]) -> Model:
    body = await request.body()
    found = await off_loop(len(body), lambda: parsed(body, model))
    most = context(request).settings.query_rows
    if len(found.states) > most:
        raise Problem(413, f"states: expected at most {most} rows, found {len(found.states)}")
    return found


async def _table(request: Request, *needed: str) -> pa.Table:
    """Return an Arrow or Parquet body; a Parquet body is decoded in a process of its own."""
    body = await request.body()
    if media_type(request) == PARQUET:
        body = await context(request).decoder.arrow(body)
    most = context(request).settings.query_rows

    def check(schema: pa.Schema) -> None:
        for name in _COLUMNS:
            _check_field(schema, name, matrix=name not in _PLACE, needed=name in needed)
        odd = [name for name in schema.names if name not in _COLUMNS]
        if odd or len(set(schema.names)) != len(schema.names):
            raise Problem(422, f"body: expected columns of {', '.join(_COLUMNS)}, found others")

    return await off_loop(len(body), lambda: read_stream(body, most_rows=most, check=check))


def _check_field(schema: pa.Schema, name: str, *, matrix: bool, needed: bool) -> None:
    if name not in schema.names:
        if not needed:
            return
        fault = Fault(detail=f"{name}: expected a column, found none", field=name)
        raise Problem(422, f"body: {fault.detail}", errors=[fault])
    kind = schema.types[schema.names.index(name)]
    if matrix:
        fits = any(test(kind) for test in _LISTS) and kind.value_type in _FLOATS
        expected = "lists of float32 or float64"
    else:
        fits, expected = kind == pa.int64(), "int64"
    if not fits:
        fault = Fault(detail=f"{name}: expected {expected}, found another type", field=name)
        raise Problem(422, f"body: {fault.detail}", errors=[fault])


_FLOATS = (pa.float32(), pa.float64())


def column_matrix(table: pa.Table, name: str, width: int) -> NDArray[Any]:
    """Return a validated column of lists as (n, width); raises a Problem naming odd rows."""
    column: Any = table[name].combine_chunks()
    if column.null_count:
        rows = np.flatnonzero(column.is_null().to_numpy(zero_copy_only=False))
        raise _row_problem(name, rows, "expected a list, found none")
    if not pa.types.is_fixed_size_list(column.type):
        lengths = column.value_lengths().to_numpy(zero_copy_only=False)
        odd = np.flatnonzero(lengths != width)
        if len(odd):
            raise _row_problem(name, odd, f"expected width {width}, found {lengths[odd[0]]}")
    elif column.type.list_size != width:
        found = column.type.list_size
        fault = Fault(detail=f"{name}: expected width {width}, found {found}", field=name)
        raise Problem(422, f"body: {fault.detail}", errors=[fault])
    cells = column.flatten()
    if cells.null_count:
        places = np.flatnonzero(cells.is_null().to_numpy(zero_copy_only=False))
        raise _cell_problem(name, [divmod(int(place), width) for place in places[:_LISTED]])
    return cells.to_numpy(zero_copy_only=False).reshape(len(column), width)


def ragged(name: str, rows: list[list[float]], width: int) -> NDArray[np.float64]:
    """Return rows of numbers as (n, width); raises a Problem naming rows of another width."""
    odd = [row for row, values in enumerate(rows) if len(values) != width]
    if odd:
        detail = f"expected width {width}, found {len(rows[odd[0]])}"
        raise _row_problem(name, np.array(odd), detail)
    return np.array(rows, np.float64).reshape(len(rows), width)


def checked(name: str, values: NDArray[Any], width: int) -> NDArray[np.float32]:
    """Return finite float32 numbers (n, width); raises a Problem naming every other cell."""
    try:
        return finite_matrix(name, values, width=width)
    except InvalidInputError:
        with np.errstate(over="ignore"):
            bad = np.argwhere(~np.isfinite(np.asarray(values, np.float32)))
        raise _cell_problem(name, [(int(row), int(column)) for row, column in bad]) from None


def _cell_problem(name: str, cells: Sequence[tuple[int, int]]) -> Problem:
    faults = [
        Fault(
            detail=f"{name}: expected a finite float32 number at row {row}, column {column}",
            field=name,
            row=row,
            column=column,
        )
        for row, column in cells[:_LISTED]
    ]
    return Problem(422, f"body: {faults[0].detail}", errors=faults)


def _row_problem(name: str, rows: NDArray[Any], detail: str) -> Problem:
    faults = [
        Fault(detail=f"{name}: {detail} at row {row}", field=name, row=int(row))
        for row in rows[:_LISTED]
    ]
    return Problem(422, f"body: {faults[0].detail}", errors=faults)


def _integers(table: pa.Table, name: str) -> NDArray[np.int64]:
    column = table[name].combine_chunks()
    if column.null_count:
        rows = np.flatnonzero(column.is_null().to_numpy(zero_copy_only=False))
        raise _row_problem(name, rows, "expected an integer, found none")
    return column.to_numpy()


def counted(episode: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the steps (n,) of rows, each episode of which begins at 0."""
    rows = np.arange(len(episode))
    begins = np.r_[True, episode[1:] != episode[:-1]][: len(rows)]
    return rows - np.maximum.accumulate(np.where(begins, rows, 0))
