"""Bins lose no pair: histograms, strips and map cells have the means of what is in them."""

import numpy as np
import pytest

from ssil_data.report.bins import build_grid, histogram, lay_out_strips


def test_a_histogram_counts_every_value_ends_included():
    shares = histogram(np.array([0.0, 0.01, 0.5, 1.0], np.float32))
    assert sum(shares) == pytest.approx(100)
    assert (shares[0], shares[10], shares[-1]) == (50.0, 25.0, 25.0)


def test_strips_hold_the_mean_of_each_bin_of_each_episode():
    lengths = np.array([5, 3, 1000])
    values = np.linspace(0, 1, lengths.sum(), dtype=np.float32)
    groups = [np.array([2, 0]), np.array([1])]
    laid_out = lay_out_strips(lengths, groups, ["bad", "good"], {"r0": values})
    assert [row["i"] for row in laid_out.rows] == [2, 0, 1]
    assert laid_out.steps == 5
    assert laid_out.rows[0]["r0"][0] == round(100 * float(values[8:13].mean()))
    assert [len(row["r0"]) for row in laid_out.rows] == [200, 1, 1]
    assert [label["name"] for label in laid_out.labels] == ["bad (2)", "good (1)"]
    assert laid_out.rows[1]["y2"] <= laid_out.rows[2]["y"]


def test_a_map_cell_is_the_mean_of_its_groups_pairs():
    positions = np.array([[0, 0], [0.1, 0.1], [10, 5], [10, 5]], np.float32)
    leverage = np.array([0.2, 0.4, 0.6, 1.0], np.float32)
    cells = build_grid(positions, np.array([0, 0, 0, 1]), 2, {"r0": leverage}, across=10)
    assert cells.cell == 1.0
    assert cells.groups[0] == {"i": [0, 10], "j": [0, 5], "pairs": [2, 1], "r0": [30, 60]}
    assert cells.groups[1]["r0"] == [100]
    assert cells.visited == [{"i": [0, 10], "j": [0, 5]}]


def test_a_map_of_one_place_has_one_cell():
    cells = build_grid(np.zeros((3, 2), np.float32), np.zeros(3, int), 1, {}, across=10)
    assert cells.size == (1, 1)
