"""Sums of distances from tables lie within their own bounds of the sums over all references."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ssil_data.kernels.totals import Totals
from support.kernel_references import draw_references

NOWHERE = np.zeros(4, np.float32)


def slow(queries: np.ndarray, states: np.ndarray, leverage: np.ndarray) -> tuple:
    offsets = states.astype(np.float64)[None] - queries.astype(np.float64)[:, None]
    distance = np.abs(offsets).sum(axis=2)
    return distance.sum(axis=1), distance @ leverage.astype(np.float64)


def assert_within(queries: np.ndarray, states: np.ndarray, leverage: np.ndarray) -> None:
    found = Totals(states, leverage, NOWHERE[: states.shape[1]])(queries)
    plain, weighted = slow(queries, states, leverage)
    for value, error, known in (
        (found.plain, found.plain_error, plain),
        (found.weighted, found.weighted_error, weighted),
    ):
        assert (error >= 0).all()
        slack = 1e-6 * np.abs(known) + 1e-6
        assert (np.abs(value - known) <= error + slack).all()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 400), st.sampled_from([1e-3, 1.0, 1e4]))
def test_the_sum_of_distances_lies_within_its_bound(seed: int, count: int, scale: float):
    (states, leverage), (queries, _) = (
        draw_references(seed, count, 4),
        draw_references(seed + 1, 20, 4),
    )
    queries[:5], queries[5:8] = states[np.arange(5) % count], queries[5:8] * 100
    states[: count // 2, 1] = states[0, 1]
    assert_within(queries * np.float32(scale), states * np.float32(scale), leverage)


@pytest.mark.parametrize("place", [0.0, -0.0, 1.0, -1.0, 0.25, 3.0, -1e6])
def test_states_and_queries_on_an_edge_are_counted_once(place: float):
    states = np.full((7, 1), place, np.float32)
    states[:3] += np.float32(0.5)
    leverage = np.linspace(0, 1, 7, dtype=np.float32)
    queries = np.array([[place], [0.0], [place + 0.5], [1e7], [-1e7]], np.float32)
    assert_within(queries, states, leverage)


def test_bounds_are_a_small_part_of_the_sums():
    (states, leverage), (queries, _) = draw_references(3, 5000, 4), draw_references(4, 100, 4)
    found = Totals(states, leverage, NOWHERE)(queries)
    assert (found.plain_error < 1e-5 * found.plain).all()
    assert (found.weighted_error < 1e-5 * found.weighted).all()
