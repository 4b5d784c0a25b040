"""Columns of the usual names are found, if they look the part."""

from pathlib import Path

import numpy as np

from ssil_data.interop import Layout
from support.foreign_files import (
    read_episodes,
    refuse,
    write_npz,
)


def test_arrays_of_the_usual_names_are_found(tmp_path: Path):
    np.savez(
        tmp_path / "plain.npz",
        states=np.ones((6, 3)),
        actions=np.ones((6, 2)),
        episode=np.repeat([0, 1], 3),
        labeled=np.repeat([1, 0], 3),
        tier=np.repeat(["expert", "0-25"], 3),
    )
    found = read_episodes(tmp_path / "plain.npz", Layout())
    assert list(found.state_names) == ["states[0]", "states[1]", "states[2]"]
    assert [(e.labeled, e.tier) for e in found.episodes] == [(True, "expert"), (False, "0-25")]


def test_a_column_that_is_named_for_one_role_is_not_guessed_for_another(tmp_path: Path):
    path = write_npz(tmp_path, position=np.arange(8.0).reshape(4, 2), reward=np.ones(4))
    assert read_episodes(path, Layout()).episodes[0].positions.shape == (4, 2)
    (episode,) = read_episodes(path, Layout(state=("position", "reward"))).episodes
    assert (episode.states.shape, episode.positions, episode.rewards) == ((4, 3), None, None)


def test_what_is_guessed_by_name_must_look_the_part(tmp_path: Path):
    columns = {
        "position": np.ones((4, 3)),
        "step": np.array([5, 6, 6, 9]),
        "reward": np.ones((4, 2)),
        "score": np.arange(4),
        "tier": np.arange(4),
    }
    path = write_npz(tmp_path, **columns)
    (episode,) = read_episodes(path, Layout()).episodes
    assert (episode.positions, episode.rewards, episode.score, episode.tier) == (None,) * 4
    expected = {
        "position": "expected two columns, x and y, as position",
        "step": "expected step 7 at row 2 of episode 0, found 6",
        "reward": "expected one value per row in column 'reward'",
        "score": "score changes at row 1, within episode 0",
        "tier": "tier changes at row 1, within episode 0",
    }
    for name, words in expected.items():
        named = (name,) if name == "position" else name
        assert words in refuse(path, Layout(**{name: named}))
