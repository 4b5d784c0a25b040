"""Files become episodes, the same ones from any format."""

from pathlib import Path

import numpy as np
import pytest

from ssil_data.demonstrations import Pairs
from ssil_data.errors import InvalidInputError
from ssil_data.interop import Layout
from support.foreign_files import (
    csv_file,
    npz_file,
    parquet_file,
    read_episodes,
    refuse,
    write_npz,
    write_text,
)


@pytest.mark.parametrize("make", [csv_file, npz_file, parquet_file])
def test_the_same_columns_of_any_format_are_the_same_episodes(tmp_path: Path, make):
    found = read_episodes(make(tmp_path))
    assert (list(found.state_names), list(found.action_names)) == (["y", "x"], ["throttle"])
    assert [len(episode) for episode in found.episodes] == [4, 4, 4]
    np.testing.assert_array_equal(found.episodes[1].states, [[8, 4], [10, 5], [12, 6], [14, 7]])
    assert [episode.score for episode in found.episodes] == [2.0, 2.0, 2.0]
    assert found.episodes[2].source.endswith("#9")


def test_unknown_labeled_episodes_missing_columns_and_other_files_are_refused(tmp_path: Path):
    path = npz_file(tmp_path)
    message = refuse(
        path, Layout(state=("x",), action=("throttle",), episode="drive", labeled=("5",))
    )
    assert "the episodes are [4, 7, 9]" in message
    assert "--labeled '5' names no episode" in message
    assert "no action column is known; name it with --action" in refuse(path, Layout(state=("x",)))
    refuse(tmp_path / "missing.npz")
    refuse(write_text(tmp_path / "drives.txt", "x"))
    refuse(tmp_path)


@pytest.mark.parametrize(
    ("score", "expected"),
    [
        (np.array(["good"] * 4), "expected numbers in column 'score', found 'good'"),
        (np.ones((4, 3)), "expected one value per row in column 'score', found shape (4, 3)"),
        (np.array([1, 1, np.nan, 1]), "found nan at row 2, column 'score'"),
        (np.array([1, 1, 2, 1]), "score changes at row 2, within episode 0"),
    ],
)
def test_a_score_is_one_number_per_episode(tmp_path: Path, score: np.ndarray, expected: str):
    assert expected in refuse(write_npz(tmp_path, score=score), Layout(score="score"))


def test_unsigned_integers_that_do_not_fit_are_refused():
    large = np.array([2**63], np.uint64)
    with pytest.raises(InvalidInputError, match="found 9223372036854775808 at row 0"):
        Pairs(np.ones((1, 1)), np.ones((1, 1)), large, np.zeros(1, int))
