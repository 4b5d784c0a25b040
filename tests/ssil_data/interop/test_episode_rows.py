"""Rows are cut into episodes, whose steps rise by one."""

from pathlib import Path

import numpy as np

from ssil_data.interop import Layout
from support.foreign_files import (
    read_episodes,
    refuse,
    write_npz,
)


def test_rows_of_an_episode_must_be_adjacent_and_their_steps_rise_by_one(tmp_path: Path):
    np.savez(
        tmp_path / "mixed.npz",
        states=np.ones((4, 1)),
        actions=np.ones((4, 1)),
        episode=[1, 1, 2, 1],
    )
    assert "episode 1 begins again at row 3" in refuse(tmp_path / "mixed.npz", Layout())
    np.savez(
        tmp_path / "skips.npz", states=np.ones((4, 1)), actions=np.ones((4, 1)), step=[5, 6, 8, 9]
    )
    assert "expected step 7 at row 2 of episode 0, found 8" in refuse(
        tmp_path / "skips.npz", Layout(step="step")
    )


def test_steps_are_compared_exactly(tmp_path: Path):
    layout = Layout(step="step")
    for first in (20_000_000, 2**60):
        steps = np.arange(first, first + 4)
        assert len(read_episodes(write_npz(tmp_path, step=steps), layout).episodes) == 1
        message = refuse(write_npz(tmp_path, step=steps + np.eye(4, dtype=int)[3]), layout)
        assert f"expected step {first + 3} at row 3 of episode 0, found {first + 4}" in message
    steps = np.array([254, 255, 0, 1], np.uint8)
    assert "expected step 256 at row 2" in refuse(write_npz(tmp_path, step=steps), layout)


def test_integral_episodes_are_integers_in_any_type(tmp_path: Path):
    path = write_npz(tmp_path, episode=np.array([0.0, 0.0, 1.0, 2.5]))
    for token, expected in (("0", [1, 0, 0]), ("0-1", [1, 1, 0]), ("2.5", [0, 0, 1])):
        found = read_episodes(path, Layout(labeled=(token,)))
        assert [e.labeled for e in found.episodes] == expected
    assert found.episodes[0].source == "plain.npz#0"


def test_an_episode_that_is_not_told_is_refused(tmp_path: Path):
    path = write_npz(tmp_path, episode=np.array([0, 0, np.nan, 1]))
    assert "expected a value in column 'episode', found nan at row 2" in refuse(path, Layout())
    path = write_npz(tmp_path, episode=np.array([0, 0, 1e300, 1]))
    assert "found 1e+300 at row 2" in refuse(path, Layout())
