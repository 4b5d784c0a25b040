"""The columns of the store's tables, and conversion between their rows and values."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data.demonstrations import Episode, Pairs
from ssil_data.errors import DamagedError, InvalidInputError

PARTS = ("aleatoric", "epistemic", "vae", "windowvae", "mdn", "gpr", "contrast")
"""The named parts of an uncertainty that the leverage table has columns for.

The last ones are the members of an ensemble.
"""

FIRST_PARTS = PARTS[:2]
"""Those that tables of the first version have."""

EPISODES = pa.schema(
    [
        pa.field("episode", pa.int64(), nullable=False),
        pa.field("length", pa.int64(), nullable=False),
        pa.field("labeled", pa.bool_(), nullable=False),
        pa.field("source", pa.string()),
        pa.field("score", pa.float64()),
        pa.field("tier", pa.string()),
        pa.field("ending", pa.string()),
    ]
)

VALUES = pa.schema(
    [
        pa.field("episode", pa.int64(), nullable=False),
        pa.field("step", pa.int64(), nullable=False),
        pa.field("uncertainty", pa.float32()),
        *(pa.field(part, pa.float32()) for part in FIRST_PARTS),
        pa.field("leverage", pa.float32()),
        pa.field("pooled", pa.float32()),
        *(pa.field(part, pa.float32()) for part in PARTS if part not in FIRST_PARTS),
    ]
)
"""One run's values, in the order of the pairs; columns that came later are last, and may be null.

A run without pooling has no `pooled`; see `scoring`.
"""


def fill_columns(values: pa.Table) -> pa.Table:
    """Return values of a run with all columns of `VALUES`; those that it lacks are null.

    Parameters
    ----------
    values
        Columns of `VALUES`, as many as were written.
    """
    missing = {
        field.name: pa.nulls(len(values), field.type)
        for field in VALUES
        if field.name not in values.column_names
    }
    for name, column in missing.items():
        values = values.append_column(name, column)
    return values.select(VALUES.names).cast(VALUES)


FIRST_COLUMNS = ("episode", "step", "uncertainty", *FIRST_PARTS, "leverage")
"""The columns that tables of the first version have, and clients of it read."""

LEVERAGE = pa.schema([pa.field("run", pa.string(), nullable=False), *VALUES])


def _numbers(name: str, names: Sequence[str] | None = None) -> pa.Field:
    """Describe a column of lists of float32, with the names of its dimensions."""
    metadata = None if names is None else {"names": json.dumps(list(names))}
    return pa.field(name, pa.list_(pa.field("element", pa.float32())), metadata=metadata)


def pairs_schema(state_names: Sequence[str], action_names: Sequence[str]) -> pa.Schema:
    """Return the columns of a pairs table; the names of the dimensions fix the widths.

    Parameters
    ----------
    state_names, action_names
        One name for each dimension, all different.

    Raises
    ------
    InvalidInputError
        For no name, or one twice.
    """
    for kind, names in (("state", state_names), ("action", action_names)):
        if not names or len(set(names)) != len(names):
            raise InvalidInputError(
                f"{kind} names: expected at least one, all different, found {list(names)}"
            )
    return pa.schema(
        [
            pa.field("episode", pa.int64(), nullable=False),
            pa.field("step", pa.int64(), nullable=False),
            _numbers("state", state_names),
            _numbers("action", action_names),
            pa.field("reward", pa.float32()),
            _numbers("position"),
        ]
    )


def dimension_names(schema: pa.Schema, column: str) -> list[str]:
    """Return the names of the dimensions of a column.

    Parameters
    ----------
    schema
        What `pairs_schema` returned.
    column
        `state` or `action`.
    """
    return json.loads(schema.field(column).metadata[b"names"])


def encode_episode(number: int, episode: Episode, schema: pa.Schema) -> pa.Table:
    """Return one episode as rows of the pairs table.

    Parameters
    ----------
    number
        Of the episode.
    episode
        The episode.
    schema
        The columns of the table.

    Raises
    ------
    InvalidInputError
        For anything but an episode, or states or actions of another width.
    """
    if not isinstance(episode, Episode):
        raise InvalidInputError(
            f"episode {number}: expected an Episode, found {type(episode).__name__}; make one with "
            "Episode(states, actions)"
        )
    for column, values in (("state", episode.states), ("action", episode.actions)):
        width = len(dimension_names(schema, column))
        if values.shape[1] != width:
            raise InvalidInputError(
                f"{column}s of episode {number}: expected width {width}, found {values.shape[1]}"
            )
    missing = pa.nulls(len(episode))
    columns = {
        "episode": np.full(len(episode), number),
        "step": np.arange(len(episode)),
        "state": _lists(episode.states),
        "action": _lists(episode.actions),
        "reward": missing if episode.rewards is None else episode.rewards,
        "position": missing if episode.positions is None else _lists(episode.positions),
    }
    return pa.table(columns).cast(schema)


def describe_episode(number: int, episode: Episode) -> dict[str, Any]:
    """Return one episode as a row of the episodes table.

    Parameters
    ----------
    number
        Of the episode.
    episode
        The episode.
    """
    kept = ("labeled", "source", "score", "tier", "ending")
    known = {name: getattr(episode, name) for name in kept}
    return {"episode": number, "length": len(episode), **known}


def decode_pairs(batch: pa.RecordBatch, schema: pa.Schema) -> Pairs:
    """Return rows of the pairs table as pairs.

    Parameters
    ----------
    batch
        The rows.
    schema
        The columns of the table, which fix the widths.

    Raises
    ------
    DamagedError
        For lists of another width.
    """
    return Pairs(
        states=matrix(batch.column("state"), len(dimension_names(schema, "state"))),
        actions=matrix(batch.column("action"), len(dimension_names(schema, "action"))),
        episode=batch.column("episode").to_numpy(),
        step=batch.column("step").to_numpy(),
    )


def matrix(column: pa.ListArray, width: int) -> NDArray[np.float32]:
    """Return a column of lists as a matrix, without a copy.

    Parameters
    ----------
    column
        n lists of float32.
    width
        The expected length of each.

    Returns
    -------
    ndarray
        (n, width) float32.

    Raises
    ------
    DamagedError
        For a list of another length.
    """
    lengths = column.value_lengths().fill_null(0).to_numpy()
    odd = np.flatnonzero(lengths != width)
    if len(odd):
        row = int(odd[0])
        raise DamagedError(f"list: expected width {width}, found {lengths[row]} at row {row}")
    return column.flatten().to_numpy().reshape(-1, width)


def _lists(values: NDArray[np.float32]) -> pa.ListArray:
    """Return a matrix as a column of lists, without a copy."""
    rows, width = values.shape
    offsets = np.arange(0, (rows + 1) * width, width, dtype=np.int32)
    return pa.ListArray.from_arrays(offsets, values.reshape(-1))
