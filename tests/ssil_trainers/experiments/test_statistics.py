"""Means, interquartile means, intervals and curves against values by hand and scipy."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import trim_mean

from ssil_trainers.experiments.statistics import (
    Curve,
    Summary,
    deviation,
    false_verdict_rate,
    interquartile_mean,
    interval,
    support,
)

RISING = Curve((0, 10, 30), (0.0, 1.0, 1.0))
FLAT = Curve((0, 10, 30), (0.1, 0.1, 0.4))


def higher(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return first.mean(axis=1) - second.mean(axis=1)


def test_the_area_of_a_curve_is_its_mean_height():
    assert RISING.area == pytest.approx((5 + 20) / 30)
    assert Curve((0,), (0.7,)).area == 0.7


def test_steps_to_a_score_are_those_of_the_first_evaluation_that_has_it():
    assert RISING.steps_to(0.9) == 10
    assert RISING.steps_to(0.0) == 0
    assert FLAT.steps_to(0.9) is None


@given(st.lists(st.floats(-10, 10), min_size=1, max_size=30))
def test_the_interquartile_mean_is_scipys_trimmed_mean(values: list[float]):
    assert interquartile_mean(values) == pytest.approx(float(trim_mean(values, 0.25)), abs=1e-12)


def test_the_interquartile_mean_leaves_the_outer_quarters_out():
    assert interquartile_mean([-100, 1, 2, 3, 4, 5, 6, 1000]) == (2 + 3 + 4 + 5) / 4


def test_the_interval_of_three_seeds_is_that_of_all_their_resamples():
    values = [0.0, 0.5, 1.0]
    means = [np.mean(drawn) for drawn in product(values, repeat=3)]
    low, high = np.quantile(means, [0.025, 0.975], method="inverted_cdf")
    assert interval([values]) == pytest.approx((low, high))


def test_resamples_stay_within_their_stratum():
    assert interval([[0.0, 0.0], [1.0, 1.0]]) == (0.5, 0.5)


def test_support_is_certain_for_scores_apart_and_even_for_equal_ones():
    assert support([1.0, 1.1], [0.0, 0.1], higher) == 1.0
    assert support([0.0, 0.1], [1.0, 1.1], higher) == 0.0
    assert support([1.0, 1.0], [1.0, 1.0], higher) == 0.5


def test_support_is_the_share_of_all_resamples():
    first = [0.0, 1.0, 2.0]
    second = [0.5, 0.5, 1.5]
    excess = [
        np.mean(a) - np.mean(b) for a in product(first, repeat=3) for b in product(second, repeat=3)
    ]
    expected = np.mean(np.array(excess) > 1e-12) + np.mean(np.abs(excess) <= 1e-12) / 2
    assert support(first, second, higher) == pytest.approx(expected, abs=0.02)


def test_a_summary_has_the_figures_of_its_seeds():
    found = Summary.of([0.9, 1.0, 0.5], [RISING, RISING, FLAT])
    assert found.mean == pytest.approx(0.8)
    assert found.deviation == pytest.approx(np.std([0.9, 1.0, 0.5], ddof=1))
    assert (found.worst, found.reached, found.steps_to_90, found.seeds) == (0.5, 2, 10, 3)
    assert found.area == pytest.approx((2 * RISING.area + FLAT.area) / 3)
    assert found.low <= found.interquartile_mean <= found.high


def test_the_expert_is_reached_at_nine_tenths_of_its_score():
    late = Curve((0, 10, 20, 30), (0.0, 0.5, 0.899, 0.9))
    found = Summary.of([0.9], [late])
    assert (found.reached, found.steps_to_90) == (1, 30)
    assert Summary.of([0.899], [Curve((0, 10), (0.0, 0.899))]).reached == 0


def test_when_most_seeds_never_reach_the_expert_there_is_no_median_of_when():
    found = Summary.of([0.9, 0.5, 0.5], [RISING, FLAT, FLAT])
    assert (found.reached, found.steps_to_90) == (1, None)


def test_one_seed_has_no_deviation():
    assert deviation([0.3]) is None


def test_the_false_verdict_rate_is_that_of_trials_one_by_one():
    def deviate(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return second.std(axis=1) - first.std(axis=1)

    for seeds, excess in ((3, higher), (5, deviate)):
        rng = np.random.default_rng(1)
        found = [
            support(3 + 2 * rng.normal(size=seeds), 3 + 2 * rng.normal(size=seeds), excess)
            for _ in range(400)
        ]
        expected = np.mean([share >= 0.95 or share <= 0.05 for share in found])
        assert false_verdict_rate(excess, seeds, 0.95) == pytest.approx(expected, abs=0.06)


def test_a_stricter_level_has_fewer_false_verdicts():
    assert false_verdict_rate(higher, 4, 0.99) < false_verdict_rate(higher, 4, 0.9)
