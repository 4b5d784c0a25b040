"""The example in the package is a true part of the committed racetrack demonstrations."""

import numpy as np
import pyarrow.parquet as pq

import ssil_data as sd
from ssil_data.example import PAIRS, read_example
from ssil_data.example.sample import sample_episodes, sample_table
from support.demonstrations import DATASETS


def test_the_file_is_what_the_script_makes_of_the_committed_dataset():
    table = sample_table(sd.Store(DATASETS)["racetrack"])
    committed = pq.read_table(PAIRS)
    assert committed.schema.metadata == table.schema.metadata
    assert committed.cast(table.schema).equals(table)
    assert PAIRS.stat().st_size <= 2_000_000


def test_reading_gives_the_committed_episodes_to_the_bit():
    racetrack = sd.Store(DATASETS)["racetrack"]
    numbers = sample_episodes(racetrack)
    rewards = racetrack.read_recorded("reward")
    positions = racetrack.read_recorded("position")
    rows = racetrack.pairs().episode
    known = racetrack.episodes.to_pylist()
    example = read_example()
    assert list(example.state_names) == racetrack.state_names
    assert list(example.action_names) == racetrack.action_names
    assert len(example.episodes) == len(numbers)
    for number, episode in zip(numbers, example.episodes, strict=True):
        pairs = racetrack.episode(number)
        np.testing.assert_array_equal(episode.states, pairs.states)
        np.testing.assert_array_equal(episode.actions, pairs.actions)
        np.testing.assert_array_equal(episode.rewards, rewards[rows == number])
        np.testing.assert_array_equal(episode.positions, positions[rows == number])
        for name in ("labeled", "score", "tier", "ending"):
            assert getattr(episode, name) == known[number][name], (number, name)
        assert episode.source == f"racetrack episode {number}: {known[number]['source']}"


def test_the_card_counts_the_episodes_and_pairs_of_each_tier():
    example = read_example()
    groups: dict[tuple[str, str], list[int]] = {}
    for episode in example.episodes:
        key = (str(episode.tier), "yes" if episode.labeled else "no")
        groups.setdefault(key, []).append(len(episode))
    assert len(groups) == 5
    for (tier, labeled), lengths in groups.items():
        assert f"| {tier} | {labeled} | {len(lengths)} | {sum(lengths):,} |" in example.card
