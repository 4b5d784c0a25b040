"""Episodes as the body of an upload: the pairs, and beside each row what its episode is."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

import pyarrow as pa

from ssil_data.client.wire import encode, rows_of_matrix
from ssil_data.demonstrations import Episode
from ssil_data.errors import InvalidInputError

_KNOWN = {
    "labeled": pa.bool_(),
    "source": pa.string(),
    "score": pa.float64(),
    "tier": pa.string(),
    "ending": pa.string(),
}


def episodes_body(
    episodes: Iterable[Episode],
    state_names: Sequence[str],
    action_names: Sequence[str],
    card: str,
) -> bytes:
    """Return episodes as an Arrow stream; names and card are metadata of its schema."""
    tables = [_rows(number, episode) for number, episode in enumerate(episodes)]
    if not tables:
        raise InvalidInputError("episodes: expected at least one, found none")
    metadata = {
        "state_names": json.dumps(list(state_names)),
        "action_names": json.dumps(list(action_names)),
        "card": card,
    }
    rows = pa.concat_tables(tables).combine_chunks()  # or each episode would be a batch
    return encode(rows.replace_schema_metadata(metadata)).to_pybytes()


def _rows(number: int, episode: Episode) -> pa.Table:
    count = len(episode)
    columns: dict[str, Any] = {
        "episode": pa.array([number] * count, pa.int64()),
        "state": rows_of_matrix(episode.states),
        "action": rows_of_matrix(episode.actions),
    }
    missing = pa.nulls(count, pa.float32())
    columns["reward"] = missing if episode.rewards is None else episode.rewards
    pair = pa.list_(pa.float32(), 2)
    positions = episode.positions
    columns["position"] = pa.nulls(count, pair) if positions is None else rows_of_matrix(positions)
    for name, kind in _KNOWN.items():
        columns[name] = pa.repeat(pa.scalar(getattr(episode, name), kind), count)
    return pa.table(columns)
