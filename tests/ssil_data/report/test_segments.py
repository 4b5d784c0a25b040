"""Segments that were planted are found, and none overlap."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssil_data.quality import spearman
from ssil_data.report.segments import correlate_ranks, cut_windows, rank_among

LENGTHS = np.array([100, 7, 60, 80])
ALL = np.ones(4, bool)


def test_planted_segments_are_found_the_worst_first():
    values = np.ones(LENGTHS.sum())
    values[30:50], values[110:130] = 0.2, 0.1
    every = cut_windows(LENGTHS, ALL)
    found = every.find_least(every.means(values), np.zeros(len(every)), count=2, per_episode=3)
    assert every.start[found].tolist() == [110, 30]
    assert every.stop[found].tolist() == [130, 50]
    assert every.episode[found].tolist() == [2, 0]


def test_segments_of_other_episodes_are_never_offered():
    every = cut_windows(LENGTHS, np.array([True, False, True, False]))
    assert set(every.episode.tolist()) == {0, 2}
    assert len(cut_windows(LENGTHS, ~ALL)) == 0
    nothing = cut_windows(LENGTHS, ~ALL)
    assert len(nothing.find_least(np.zeros(0), np.zeros(0), count=5, per_episode=2)) == 0


def test_an_episode_shorter_than_a_window_is_one_window():
    every = cut_windows(LENGTHS, ALL)
    assert every.start[every.episode == 1].tolist() == [100]
    assert every.stop[every.episode == 1].tolist() == [107]


def test_equal_measures_are_ordered_by_the_second_key():
    every = cut_windows(np.array([20, 20, 20]), np.ones(3, bool))
    found = every.find_least(np.zeros(3), np.array([2.0, 0.0, 1.0]), count=3, per_episode=1)
    assert found.tolist() == [1, 2, 0]


@given(
    st.lists(st.integers(1, 70), min_size=1, max_size=8),
    st.integers(1, 30),
    st.integers(1, 4),
    st.integers(0, 2**32 - 1),
)
def test_segments_never_overlap_nor_leave_their_episode(
    lengths: list[int], steps: int, per_episode: int, seed: int
):
    sizes = np.array(lengths)
    values = np.random.default_rng(seed).integers(0, 3, sizes.sum()).astype(float)
    every = cut_windows(sizes, np.ones(len(sizes), bool), steps=steps)
    means = every.means(values)
    found = every.find_least(means, every.start, count=10, per_episode=per_episode)
    ends = zip(every.start[found].tolist(), every.stop[found].tolist(), strict=True)
    rows = np.concatenate([np.arange(start, stop) for start, stop in ends])
    assert len(set(rows.tolist())) == len(rows)
    assert np.bincount(every.episode[found]).max() <= per_episode
    assert (np.diff(means[found]) >= 0).all()
    assert means[found[0]] == means.min()
    owner = np.repeat(np.arange(len(sizes)), sizes)
    assert (owner[every.start] == owner[every.stop - 1]).all()


def test_standings_correlate_as_spearman_says():
    rng = np.random.default_rng(0)
    values = rng.integers(0, 9, (3, 200)).astype(float)
    values[2] = 1.0
    among = np.ones(200, bool)
    matrix = correlate_ranks(np.stack([rank_among(row, among) for row in values]))
    assert matrix[0, 1] == pytest.approx(spearman(values[0], values[1]))
    assert matrix[0, 0] == pytest.approx(1)
    assert np.isnan(matrix[2]).all()


def test_a_standing_is_the_share_of_the_unlabeled_pairs_below():
    values, among = np.array([0.0, 1.0, 2.0, 3.0, 9.0]), np.array([1, 1, 1, 1, 0], bool)
    assert rank_among(values, among).tolist() == [0.125, 0.375, 0.625, 0.875, 1.0]
