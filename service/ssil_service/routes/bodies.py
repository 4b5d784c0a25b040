"""What clients send, as arrays: JSON, Arrow or Parquet, checked before anything is computed."""

from __future__ import annotations

import asyncio
import gc
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
from fastapi import Request
from numpy.typing import NDArray
from pydantic import BaseModel, ValidationError
from pydantic_core import from_json

from ssil_data.client.wire import ARROW, JSON, PARQUET
from ssil_data.demonstrations import Pairs
from ssil_service.context import context
from ssil_service.formats.arrays import (
    check_float32,
    field_problem,
    integers_from_column,
    integers_from_json,
    matrix_from_column,
    rows_from_json,
)
from ssil_service.formats.arrow import read_stream
from ssil_service.formats.arrow_template import ArrowTemplates
from ssil_service.problems import SHOWN, Fault, Problem, of_validation
from ssil_service.queries.admission import BoundedExecutor
from ssil_service.schemas.requests import PairsBody, StatesBody

Model = TypeVar("Model", bound=BaseModel)
Answer = TypeVar("Answer")
RUN_BYTES = 65_536
"""Largest body that asks for a run: settings, and nothing else."""
_INLINE = 2**16
_FORMS = ArrowTemplates()
_LISTS = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)


def read_settings_body(body: bytes, model: type[Model]) -> Model:
    """Return a small JSON body as a model; raises a Problem that names every offending place."""
    if len(body) > RUN_BYTES:
        raise Problem(413, f"body: expected at most {RUN_BYTES} bytes of settings, found more")
    try:
        return model.model_validate_json(body)
    except ValidationError as error:
        found = error.errors(include_url=False, include_context=False, include_input=False)
        raise of_validation(found, "body") from None


async def read_states(request: Request, width: int) -> NDArray[np.float32]:
    """Return the states (m, d) of a question."""
    media, body, most = await _body(request)

    def read() -> NDArray[np.float32]:
        if media == JSON:
            return rows_from_json("states", _fields(body, StatesBody, most)["states"], width)
        known = _FORMS.numbers(body, width, most)
        if known is not None:
            return check_float32("state", known, width)
        matrix = matrix_from_column(_table(body, most, "state"), "state", width)
        _FORMS.learn(body, matrix, width, most)
        return check_float32("state", matrix, width)

    return await run_off_loop(len(body), read, context(request).executor_for(media))


async def read_pairs(request: Request, widths: tuple[int, int]) -> Pairs:
    """Return the pairs of a question; without episode and step they are one episode."""
    media, body, most = await _body(request)

    def read() -> Pairs:
        if media == JSON:
            given = _fields(body, PairsBody, most)
            states = rows_from_json("states", given["states"], widths[0])
            actions = rows_from_json("actions", given["actions"], widths[1])
            known = {n: given[n] for n in _PLACE if given.get(n) is not None}
            place = {name: integers_from_json(name, values) for name, values in known.items()}
        else:
            table = _table(body, most, "state", "action")
            states, actions = (
                check_float32(name, matrix_from_column(table, name, width), width)
                for name, width in zip(("state", "action"), widths, strict=True)
            )
            known = [name for name in _PLACE if name in table.column_names]
            place = {name: integers_from_column(table, name) for name in known}
        episode = place.get("episode", np.zeros(len(states), np.int64))
        step = place["step"] if "step" in place else number_steps(episode)
        return Pairs(states=states, actions=actions, episode=episode, step=step)

    return await run_off_loop(len(body), read, context(request).executor_for(media))


_PLACE = ("episode", "step")
_COLUMNS = ("state", "action", *_PLACE)


def media_type(
    request: Request, offered: Sequence[str] = (JSON, ARROW, PARQUET), *, unnamed: str = ""
) -> str:
    """Return the body's media type, `unnamed` if the request names none.

    Raises a Problem with 415 for another, or any coding.
    """
    if request.headers.get("content-encoding", "identity").lower() != "identity":
        raise Problem(415, "Content-Encoding: expected none, found one")
    given = request.headers.get("content-type", unnamed).partition(";")[0].strip().lower()
    if given not in offered:
        raise Problem(415, f"Content-Type: expected one of {', '.join(offered)}, found another")
    return given


async def run_off_loop(
    size: int, work: Callable[[], Answer], place: BoundedExecutor | None = None
) -> Answer:
    """Do small work here and now, large work in a thread, or where its form waits.

    Raises a Problem with 503 when too many wait there.
    """
    if size <= _INLINE:
        return work()
    if place is None:
        return await asyncio.to_thread(work)
    return await place.run(lambda: _without_garbage_collection(work))


def _without_garbage_collection(work: Callable[[], Answer]) -> Answer:
    """Do what makes many lists but no cycles: the collector would go through them all the time.

    Of 1.4 million lists in 4 MB of JSON it makes five times the work, during which nobody answers.
    """
    if not gc.isenabled():
        return work()
    gc.disable()
    try:
        return work()
    finally:
        gc.enable()


async def _body(request: Request) -> tuple[str, bytes, int]:
    """Return a question's form, its body, and how many rows it may have.

    A Parquet body is decoded in a process of its own, and is Arrow from then on.
    """
    media, here = media_type(request), context(request)
    body = await request.body()
    if media == PARQUET:
        media, body = ARROW, await here.decoder.arrow(body)
    return media, body, here.settings.query_rows


def _fields(body: bytes, model: type[BaseModel], most: int) -> dict[str, Any]:
    """Return the fields of a JSON object, whose names and number of rows are right."""
    try:
        found = from_json(body, allow_inf_nan=False)
    except ValueError as error:  # tells the place, and quotes nothing
        raise Problem(422, f"body: Invalid JSON: {error}") from None
    if type(found) is not dict:
        raise Problem(422, "body: expected an object, found another value")
    missing = [n for n, known in model.model_fields.items() if known.is_required()]
    faults = [
        Fault(detail=f"{name}: Field required", field=name) for name in missing if name not in found
    ]
    for name in found:
        if name not in model.model_fields and len(faults) < SHOWN:
            shown = name[:100]
            faults.append(Fault(detail=f"{shown}: Extra inputs are not permitted", field=shown))
    if faults:
        raise Problem(422, f"body: {faults[0].detail}", errors=faults)
    for name in ("states", "actions"):
        if type(found.get(name)) is list and len(found[name]) > most:
            raise Problem(413, f"{name}: expected at most {most} rows, found {len(found[name])}")
    return found


def _table(body: bytes, most: int, *needed: str) -> pa.Table:
    """Return an Arrow body whose columns are known, and those needed among them."""

    def check(schema: pa.Schema) -> None:
        names = schema.names
        for name in _COLUMNS:
            if name in names:
                _check_type(name, schema.types[names.index(name)])
            elif name in needed:
                raise field_problem(name, "expected a column, found none")
        if not set(names) <= set(_COLUMNS) or len(set(names)) != len(names):
            raise Problem(422, f"body: expected columns of {', '.join(_COLUMNS)}, found others")

    return read_stream(body, most_rows=most, check=check)


def _check_type(name: str, kind: pa.DataType) -> None:
    if name in _PLACE:
        fits, expected = kind == pa.int64(), "int64"
    else:
        fits = any(test(kind) for test in _LISTS) and kind.value_type in _FLOATS
        expected = "lists of float32 or float64"
    if not fits:
        raise field_problem(name, f"expected {expected}, found another type")


_FLOATS = (pa.float32(), pa.float64())


def number_steps(episode: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the steps (n,) of rows, each episode of which begins at 0."""
    rows = np.arange(len(episode))
    begins = np.r_[True, episode[1:] != episode[:-1]][: len(rows)]
    return rows - np.maximum.accumulate(np.where(begins, rows, 0))
