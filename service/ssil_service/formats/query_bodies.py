"""Bodies of queries as arrays: states, or state-action pairs, in JSON or as an Arrow stream."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data.client.wire import JSON
from ssil_data.demonstrations import Pairs
from ssil_service.formats.arrays import check_float32, integers_from_column, matrix_from_column
from ssil_service.formats.arrow import read_stream
from ssil_service.formats.arrow_template import ArrowTemplates
from ssil_service.formats.faults import field_problem
from ssil_service.formats.json_arrays import (
    integers_from_json,
    is_null,
    matrix_from_json,
    read_object,
)
from ssil_service.problems import Problem
from ssil_service.schemas.requests import PairsBody, StatesBody

_NUMBERING = ("episode", "step")
_COLUMNS = ("state", "action", *_NUMBERING)
_FLOATS = (pa.float32(), pa.float64())
_LISTS = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)
_TEMPLATES = ArrowTemplates()


def read_states(body: bytes, media: str, *, width: int, most_rows: int) -> NDArray[np.float32]:
    """Read the states of a query.

    Parameters
    ----------
    body
        JSON with `states`, or an Arrow stream with the column `state`.
    media
        Media type of the body, JSON's or Arrow's.
    width
        Dimensions of a state.
    most_rows
        States that there may be.

    Returns
    -------
    NDArray
        (m, width), finite, in raw units.

    Raises
    ------
    Problem
        413 for too many rows, 415 for compressed Arrow buffers, 422 for everything else, naming
        rows and cells.
    """
    if media == JSON:
        fields = read_object(body, StatesBody)
        return matrix_from_json("states", fields["states"], width, most_rows=most_rows)
    known = _TEMPLATES.numbers(body, width, most_rows)
    if known is not None:
        return check_float32("state", known, width)
    matrix = matrix_from_column(_read_table(body, most_rows, "state"), "state", width)
    _TEMPLATES.add(body, matrix, width, most_rows)
    return check_float32("state", matrix, width)


def read_pairs(body: bytes, media: str, *, widths: tuple[int, int], most_rows: int) -> Pairs:
    """Read the state-action pairs of a query; without episode and step they are one episode.

    Parameters
    ----------
    body
        JSON with `states`, `actions` and optionally `episode` and `step`, or an Arrow stream with
        the columns `state`, `action` and optionally `episode` and `step`.
    media
        Media type of the body, JSON's or Arrow's.
    widths
        Dimensions of a state and of an action.
    most_rows
        Pairs that there may be.

    Returns
    -------
    Pairs
        The pairs, finite, in raw units.

    Raises
    ------
    Problem
        As `read_states` does.
    InvalidInputError
        For columns of different lengths.
    """
    if media == JSON:
        fields = read_object(body, PairsBody)
        states = matrix_from_json("states", fields["states"], widths[0], most_rows=most_rows)
        actions = matrix_from_json("actions", fields["actions"], widths[1], most_rows=most_rows)
        given = [name for name in _NUMBERING if name in fields and not is_null(fields[name])]
        numbering = {name: integers_from_json(name, fields[name]) for name in given}
    else:
        table = _read_table(body, most_rows, "state", "action")
        states, actions = (
            check_float32(name, matrix_from_column(table, name, width), width)
            for name, width in zip(("state", "action"), widths, strict=True)
        )
        given = [name for name in _NUMBERING if name in table.column_names]
        numbering = {name: integers_from_column(table, name) for name in given}
    episode = numbering.get("episode", np.zeros(len(states), np.int64))
    step = numbering["step"] if "step" in numbering else number_steps(episode)
    return Pairs(states=states, actions=actions, episode=episode, step=step)


def number_steps(episode: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number the steps of every episode from 0.

    Parameters
    ----------
    episode
        (n,), the episode of every row; the rows of one are adjacent.

    Returns
    -------
    NDArray
        (n,).
    """
    rows = np.arange(len(episode))
    begins = np.r_[True, episode[1:] != episode[:-1]][: len(rows)]
    return rows - np.maximum.accumulate(np.where(begins, rows, 0))


def _read_table(body: bytes, most_rows: int, *needed: str) -> pa.Table:
    """Return an Arrow body that has the needed columns and no unknown ones."""

    def check(schema: pa.Schema) -> None:
        names = schema.names
        for name in _COLUMNS:
            if name in names:
                _check_type(name, schema.types[names.index(name)])
            elif name in needed:
                raise field_problem(name, "the column is missing")
        if not set(names) <= set(_COLUMNS) or len(set(names)) != len(names):
            known = ", ".join(_COLUMNS)
            raise Problem(422, f"body: only the columns {known} are accepted, each once")

    return read_stream(body, most_rows=most_rows, check=check)


def _check_type(name: str, found: pa.DataType) -> None:
    if name in _NUMBERING:
        fits = found == pa.int64()
        expected = "int64"
    else:
        fits = any(test(found) for test in _LISTS) and found.value_type in _FLOATS
        expected = "lists of float32 or float64"
    if not fits:
        raise field_problem(name, f"expected {expected}, found another type")
