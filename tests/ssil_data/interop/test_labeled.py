"""Labeled episodes are chosen by a column, by value or by range."""

from pathlib import Path

import numpy as np
import pytest

from ssil_data.interop import Layout
from support.foreign_files import (
    csv_file,
    npz_file,
    parquet_file,
    read_episodes,
    refuse,
    write_npz,
)


@pytest.mark.parametrize(
    ("labeled", "expected"),
    [
        ((), [False, False, False]),
        (("good",), [True, False, False]),
        (("7",), [False, True, False]),
        (("4", "9"), [True, False, True]),
        (("4,9",), [True, False, True]),
        (("4-7",), [True, True, False]),
        (("all",), [True, True, True]),
    ],
)
def test_labeled_episodes_are_chosen_by_column_value_or_range(
    tmp_path: Path, labeled: tuple[str, ...], expected: list[bool]
):
    layout = Layout(state=("x",), action=("throttle",), episode="drive", labeled=labeled)
    for make in (csv_file, npz_file, parquet_file):
        found = read_episodes(make(tmp_path), layout)
        assert [episode.labeled for episode in found.episodes] == expected


def test_a_label_that_changes_within_an_episode_is_refused(tmp_path: Path):
    np.savez(
        tmp_path / "l.npz", states=np.ones((4, 1)), actions=np.ones((4, 1)), labeled=[1, 1, 0, 1]
    )
    assert "labeled changes at row 2, within episode 0" in refuse(tmp_path / "l.npz", Layout())


def test_a_range_of_episodes_passes_over_what_only_looks_like_a_number(tmp_path: Path):
    path = write_npz(tmp_path, episode=np.array(["²", "1", "3", "x"]))
    found = read_episodes(path, Layout(labeled=("1-3",)))
    assert [e.labeled for e in found.episodes] == [False, True, True, False]
    assert "--labeled '²-³' names no episode" in refuse(path, Layout(labeled=("²-³",)))


@pytest.mark.parametrize("token", ["", ",", "nope", "5-9", "9" * 5000 + "-" + "9" * 5000])
def test_labeled_without_an_episode_is_refused(tmp_path: Path, token: str):
    message = refuse(write_npz(tmp_path), Layout(labeled=(token,)))
    assert f"--labeled {token!r} names no episode" in message


def test_a_labeled_range_must_begin_and_end_at_an_episode(tmp_path: Path):
    path = npz_file(tmp_path)
    for labeled in ("0-7", "4-8", "9-4"):
        layout = Layout(state=("x",), action=("throttle",), episode="drive", labeled=(labeled,))
        assert f"--labeled '{labeled}' names no episode" in refuse(path, layout)
