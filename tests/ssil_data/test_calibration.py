"""Leverage that is a chance has no calibration error; what is too sure or too shy has."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssil_data.calibration import BINS, find_calibration


def test_a_chance_that_is_true_has_almost_no_error():
    random = np.random.default_rng(0)
    chance = random.uniform(size=40_000)
    expert = random.uniform(size=40_000) < chance
    curve = find_calibration(chance[expert], chance[~expert])
    assert curve.error < 0.01
    assert curve.pairs.tolist() == [4000] * BINS
    np.testing.assert_allclose(curve.leverage, np.arange(0.05, 1, 0.1), atol=0.01)


@pytest.mark.parametrize(("leverage", "error"), [(1.0, 0.75), (0.25, 0.0), (0.0, 0.25)])
def test_one_leverage_for_all_is_one_bin_and_is_off_by_its_distance_from_the_share(
    leverage: float, error: float
):
    curve = find_calibration(np.full(25, leverage), np.full(75, leverage))
    assert curve.pairs.tolist() == [100]
    assert curve.error == pytest.approx(error)


def test_a_rank_is_no_chance():
    """Perfectly ranked, but half of the leverage is far from 0 and 1."""
    curve = find_calibration(np.linspace(0.9, 1, 100), np.linspace(0, 0.9, 900))
    assert curve.error > 0.3


shares = st.lists(st.floats(0, 1), min_size=1, max_size=60)


@given(shares, shares)
def test_no_pair_is_lost_and_the_error_is_a_share(expert: list[float], negative: list[float]):
    curve = find_calibration(np.array(expert), np.array(negative))
    assert curve.pairs.sum() == len(expert) + len(negative)
    assert curve.pairs @ curve.expert_share == pytest.approx(len(expert))
    assert curve.pairs @ curve.leverage == pytest.approx(sum(expert) + sum(negative))
    assert 0 <= curve.error <= 1
