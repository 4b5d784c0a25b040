"""Standardized values and windows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ssil_data.errors import InvalidInputError
from ssil_data.features import FARTHEST, Standardizer, windows


def test_standardized_values_have_mean_zero_and_deviation_one():
    values = np.random.default_rng(0).normal([3, -7e4], [0.01, 900], (500, 2)).astype(np.float32)
    standard = Standardizer.of(values)(values)
    np.testing.assert_allclose(standard.mean(axis=0), 0, atol=1e-3)
    np.testing.assert_allclose(standard.std(axis=0), 1, rtol=1e-3)
    assert standard.dtype == np.float32


@pytest.mark.parametrize("constant", [0.0, 0.1, 1000.1, -3e30, 1e-30])
def test_a_constant_dimension_gets_scale_one(constant: float):
    values = np.full((100, 1), constant, np.float32)
    assert Standardizer.of(values).scale == [1]


def test_a_stray_last_bit_is_not_blown_up_to_deviations():
    values = np.full((100, 1), 1000.0, np.float32)
    values[::2] = np.nextafter(np.float32(1000), np.float32(2000))
    assert Standardizer.of(values).scale == [1]


def test_a_small_dimension_keeps_its_own_scale():
    values = np.array([[1e-6], [2e-6], [3e-6]], np.float32)
    assert Standardizer.of(values).scale < 1e-6


def test_values_that_would_overflow_are_clipped():
    standardizer = Standardizer.of(np.array([[0.0], [1e-20]], np.float32))
    far = np.array([[3e38], [-3e38]], np.float32)
    assert standardizer(far).tolist() == [[FARTHEST], [-FARTHEST]]


def test_moments_and_values_make_the_same_standardizer():
    values = np.random.default_rng(1).normal(size=(50, 3))
    one = Standardizer.of(values)
    two = Standardizer.of_moments(values.mean(axis=0), values.var(axis=0))
    assert (one.shift == two.shift).all() and (one.scale == two.scale).all()


def test_standardizing_leaves_its_input_untouched():
    values = np.ones((4, 2), np.float32)
    Standardizer.of(values)(values)
    assert (values == 1).all()


def test_another_width_is_refused_naming_both_sides():
    with pytest.raises(InvalidInputError, match=r"expected width 2, found shape \(4, 3\)"):
        Standardizer.of(np.ones((4, 2)))(np.ones((4, 3)))


@pytest.mark.parametrize(
    ("shift", "scale"),
    [([0.0], [0.0]), ([0.0], [-1.0]), ([0.0, 0.0], [1.0]), ([np.nan], [1.0]), ([[0.0]], [[1.0]])],
)
def test_a_shift_and_scale_that_do_not_fit_are_refused(shift: list, scale: list):
    with pytest.raises(InvalidInputError):
        Standardizer(np.array(shift), np.array(scale))


def test_no_rows_are_refused():
    with pytest.raises(InvalidInputError, match="at least one row"):
        Standardizer.of(np.empty((0, 2)))


lengths = st.lists(st.integers(1, 6), min_size=0, max_size=8)


@given(lengths)
def test_windows_never_cross_episodes(lengths: list[int]):
    episode = np.repeat(np.arange(len(lengths)), lengths)
    states = np.column_stack([episode, np.arange(len(episode))]).astype(np.float32)
    both = windows(states, episode)
    assert both.shape == (len(states), 4)
    assert (both[:, 0] == episode).all() and (both[:, 2] == episode).all()


@given(lengths)
def test_windows_are_what_a_loop_over_episodes_gives(lengths: list[int]):
    expected, states, row = [], [], 0.0
    for length in lengths:
        own = [[row + step] for step in range(length)]
        for step in range(length):
            first = min(step, max(length - 2, 0))
            expected.append(own[first] + own[min(first + 1, length - 1)])
        states += own
        row += length
    episode = np.repeat(np.arange(len(lengths)), lengths)
    found = windows(np.array(states, np.float32).reshape(-1, 1), episode)
    np.testing.assert_array_equal(found, np.array(expected, np.float32).reshape(-1, 2))


def test_windows_of_another_number_of_episodes_are_refused():
    with pytest.raises(InvalidInputError, match="2 != 3"):
        windows(np.ones((3, 1), np.float32), np.zeros(2, np.int64))


@given(arrays(np.float32, (7, 2), elements=st.floats(-(2.0**99), 2.0**99, width=32)))
def test_standardized_values_are_finite_whatever_the_values(values: np.ndarray):
    assert np.isfinite(Standardizer.of(values)(values)).all()
