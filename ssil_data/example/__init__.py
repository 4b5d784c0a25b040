"""A small sample of the simulated racetrack demonstrations, shipped inside the package.

It lets `score`, `show` and `report` be tried without a checkout. `sample.py` tells which episodes
of `datasets/racetrack` it holds, and writes the file again.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ssil_data.demonstrations import Episode

PAIRS = Path(__file__).with_name("racetrack.parquet")
"""One row per pair: state, action, reward, position, and what is known of its episode."""
_CARD = Path(__file__).with_name("card.md")


@dataclass(frozen=True)
class ExampleDataset:
    """Demonstrations ready for `Store.create`.

    Parameters
    ----------
    episodes:
        51 episodes, 6 of them labeled, with their true score, tier and positions.
    state_names, action_names:
        Names of the 29 state dimensions and of the 2 action dimensions.
    card:
        Where the demonstrations come from, Markdown.
    """

    episodes: tuple[Episode, ...]
    state_names: tuple[str, ...]
    action_names: tuple[str, ...]
    card: str


def read_example() -> ExampleDataset:
    """Read the sample that the package carries: 14,350 simulated pairs of a racing car.

    Returns
    -------
    ExampleDataset
        The same rows, to the bit, as those episodes of `datasets/racetrack`.
    """
    table = pq.read_table(PAIRS).combine_chunks()
    names = json.loads(table.schema.metadata[b"names"])
    numbers = table["episode"].to_numpy()
    starts = np.flatnonzero(np.r_[True, numbers[1:] != numbers[:-1]])
    lengths = np.diff(starts, append=len(numbers))
    return ExampleDataset(
        episodes=tuple(
            _episode(table.slice(int(start), int(length)))
            for start, length in zip(starts, lengths, strict=True)
        ),
        state_names=tuple(names["state"]),
        action_names=tuple(names["action"]),
        card=_CARD.read_text(encoding="utf-8"),
    )


def _episode(rows: pa.Table) -> Episode:
    """Return the rows of one episode as a value; what is known of it stands in every row."""
    known = rows.select(["labeled", "source", "score", "tier", "ending"]).slice(0, 1).to_pylist()[0]
    return Episode(
        states=_matrix(rows["state"]),
        actions=_matrix(rows["action"]),
        rewards=rows["reward"].to_numpy(),
        positions=_matrix(rows["position"]),
        **known,
    )


def _matrix(column: pa.ChunkedArray) -> NDArray[np.float32]:
    """Return lists of one width as the rows of an array."""
    lists: Any = column.combine_chunks()
    return lists.flatten().to_numpy().reshape(len(column), -1)
