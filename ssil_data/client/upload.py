"""Episodes as the body of an upload: the pairs, and beside each row what its episode is.

Both sides of the wire take the columns of an upload from here.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

import pyarrow as pa

from ssil_data.client.wire import encode, rows_of_matrix
from ssil_data.demonstrations import Episode
from ssil_data.errors import InvalidInputError
from ssil_data.store.arrow_schema import EPISODES

EPISODE_COLUMNS: dict[str, pa.DataType] = {
    field.name: field.type for field in EPISODES if field.name not in ("episode", "length")
}
"""What is known of a whole episode, as the store's episodes table has it: one value in all rows."""

PAIR_COLUMNS = {"reward": "rewards", "position": "positions"}
"""What may be recorded of each pair, and the field of `Episode` that it is."""

NAME_KEYS = ("state_names", "action_names")
"""Metadata of the schema with the names of the dimensions, each a JSON list."""

CARD_KEY = "card"
"""Metadata of the schema with the dataset's card, Markdown."""


def episodes_body(
    episodes: Iterable[Episode],
    state_names: Sequence[str],
    action_names: Sequence[str],
    card: str,
) -> bytes:
    """Return episodes as the body of an upload, an Arrow stream.

    Parameters
    ----------
    episodes
        At least one.
    state_names, action_names
        The names of the dimensions.
    card
        The dataset's card, Markdown; not used when episodes are added.

    Raises
    ------
    InvalidInputError
        For no episode.
    """
    tables = [_rows(number, episode) for number, episode in enumerate(episodes)]
    if not tables:
        raise InvalidInputError("episodes: expected at least one, found none")
    names = (state_names, action_names)
    metadata = {key: json.dumps(list(value)) for key, value in zip(NAME_KEYS, names, strict=True)}
    rows = pa.concat_tables(tables).combine_chunks()  # or each episode would be a batch
    return encode(rows.replace_schema_metadata({**metadata, CARD_KEY: card})).to_pybytes()


def _rows(number: int, episode: Episode) -> pa.Table:
    """Return one episode as rows of the body."""
    count = len(episode)
    columns: dict[str, Any] = {
        "episode": pa.array([number] * count, pa.int64()),
        "state": rows_of_matrix(episode.states),
        "action": rows_of_matrix(episode.actions),
    }
    rewards = episode.rewards
    positions = episode.positions
    columns["reward"] = pa.nulls(count, pa.float32()) if rewards is None else rewards
    pair = pa.list_(pa.float32(), 2)
    columns["position"] = pa.nulls(count, pair) if positions is None else rows_of_matrix(positions)
    for name, kind in EPISODE_COLUMNS.items():
        columns[name] = pa.repeat(pa.scalar(getattr(episode, name), kind), count)
    return pa.table(columns)
