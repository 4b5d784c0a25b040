"""Normal scores of ranks: monotone, and comparable between estimators of any units."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.special import ndtr

from ssil_data.ranks import FARTHEST, KNOTS, find_knots, interpolate, normal_scores

numbers = st.floats(-(2.0**127), 2.0**127, width=32)
pools = arrays(np.float32, st.integers(1, 80), elements=numbers)


@given(pool=pools, queries=pools)
def test_scores_never_fall_and_stay_within_their_ends(pool: NDArray, queries: NDArray):
    knots = find_knots(pool)
    assert knots.shape == (KNOTS,) and (np.diff(knots) >= 0).all()
    scores = normal_scores(np.sort(queries), knots)
    assert scores.dtype == np.float32
    assert (np.diff(scores) >= 0).all()
    assert (np.abs(scores) <= FARTHEST).all()


@given(places=pools, queries=pools, falling=st.booleans())
def test_interpolation_keeps_the_order(places: NDArray, queries: NDArray, falling: bool):
    places = np.unique(places.astype(np.float64))
    heights = np.linspace(1, 0, len(places)) if falling else np.linspace(-4, 4, len(places))
    found = interpolate(np.sort(queries), places, heights)
    steps = np.diff(found)
    assert (steps <= 0).all() if falling else (steps >= 0).all()
    np.testing.assert_array_equal(interpolate(places, places, heights), np.float32(heights))
    assert heights.min() <= found.min() and found.max() <= heights.max()


def test_a_piece_across_huge_numbers_does_not_overshoot():
    knots = find_knots([0.0, -1.7222205e18, 0.0, -1.0, -1.0, -1.0])
    scores = normal_scores([-2.0, -1.0], knots)
    assert scores[0] <= scores[1]


@pytest.mark.parametrize("change", [lambda r: 7 * r + 3, np.exp, lambda r: r**3])
def test_scores_do_not_depend_on_units(change):
    pool = np.random.default_rng(0).normal(size=5001)
    expected = normal_scores(pool, find_knots(pool))
    found = normal_scores(change(pool), find_knots(change(pool)))
    np.testing.assert_allclose(found, expected, atol=0.02)


def test_scores_of_the_pool_are_its_ranks():
    pool = np.random.default_rng(0).lognormal(size=20_000)
    ranks = (np.argsort(np.argsort(pool)) + 0.5) / len(pool)
    np.testing.assert_allclose(ndtr(normal_scores(pool, find_knots(pool))), ranks, atol=2e-3)


def test_equal_values_get_the_middle_of_their_ranks():
    pool = np.repeat([0.0, 1.0], [500, 500])
    scores = normal_scores([0.0, 1.0], find_knots(pool))
    assert scores[0] == pytest.approx(-scores[1], abs=0.1)
    assert (normal_scores([5.0], find_knots(np.full(9, 5.0))) == 0).all()


def test_infinite_values_get_the_ends():
    knots = find_knots(np.arange(100.0))
    scores = normal_scores([-np.inf, -1e9, 1e9, np.inf], knots)
    assert scores[0] == scores[1] == -scores[2] == -scores[3]
