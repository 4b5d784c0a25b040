"""Which episodes of `datasets/racetrack` make the example, and the script that writes its file.

    python -m ssil_data.example.sample datasets

Every k-th episode of each tier in the order of the dataset, and all labeled ones: no choice by
score, so the sample is as hard as the whole set.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ssil_data.example import PAIRS
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset

TAKE_EVERY = {"expert": 4, "50-75": 3, "25-50": 4, "0-25": 5}
"""Tier of unlabeled episodes → the first, and then every so many-th, is in the sample."""


def sample_episodes(dataset: Dataset) -> list[int]:
    """Return the numbers of the episodes in the sample, in rising order.

    Parameters
    ----------
    dataset:
        The committed racetrack demonstrations.
    """
    seen: Counter[str] = Counter()
    chosen = []
    for row in dataset.episodes.to_pylist():
        if row["labeled"]:
            chosen.append(row["episode"])
        else:
            if seen[row["tier"]] % TAKE_EVERY[row["tier"]] == 0:
                chosen.append(row["episode"])
            seen[row["tier"]] += 1
    return chosen


def sample_table(dataset: Dataset) -> pa.Table:
    """Return the sample as one row per pair, with what is known of its episode in every row.

    Parameters
    ----------
    dataset:
        The committed racetrack demonstrations.
    """
    known = {row["episode"]: row for row in dataset.episodes.to_pylist()}
    rewards = dataset.read_recorded("reward")
    positions = dataset.read_recorded("position")
    assert rewards is not None
    assert positions is not None
    numbers = dataset.pairs().episode
    parts = []
    for number in sample_episodes(dataset):
        pairs = dataset.episode(number)
        rows = numbers == number
        repeated = {
            name: [known[number][name]] * len(pairs)
            for name in ("labeled", "score", "tier", "ending")
        }
        columns = {
            "episode": pairs.episode,
            "state": pa.array(list(pairs.states), pa.list_(pa.float32())),
            "action": pa.array(list(pairs.actions), pa.list_(pa.float32())),
            "reward": rewards[rows],
            "position": pa.array(list(positions[rows]), pa.list_(pa.float32())),
            **repeated,
            "source": [f"{dataset.name} episode {number}: {known[number]['source']}"] * len(pairs),
        }
        parts.append(pa.table(columns))
    names = {"state": dataset.state_names, "action": dataset.action_names}
    return pa.concat_tables(parts).replace_schema_metadata({"names": json.dumps(names)})


def write_sample(dataset: Dataset, path: Path) -> None:
    """Write the sample as Parquet: byte streams of floats split and packed hard, for the wheel.

    Parameters
    ----------
    dataset:
        The committed racetrack demonstrations.
    path:
        The file to write.
    """
    floats = ["state.list.element", "action.list.element", "position.list.element", "reward"]
    options: dict[str, Any] = {
        "use_dictionary": ["episode", "labeled", "score", "tier", "ending", "source"],
        "use_byte_stream_split": floats,
    }
    pq.write_table(sample_table(dataset), path, compression="zstd", compression_level=19, **options)


if __name__ == "__main__":
    write_sample(Store(sys.argv[1])["racetrack"], PAIRS)
