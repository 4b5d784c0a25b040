"""LCoR from a random part of the demonstrations: how exact it says it is, and how exact it is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ssil_data import InvalidInputError
from support.leverage_fields import field, made_anew, queries


def test_without_accuracy_answers_are_exact():
    answer = field().lcor(queries())
    assert (answer.half_width == 0).all()
    sums = field().sums(queries())
    np.testing.assert_array_equal(answer.values, sums.values)


@pytest.mark.parametrize("tolerance", [0.02, 0.004])
def test_answers_to_a_tolerance_lie_within_it(tolerance: float):
    exact = field().lcor(queries())
    answer = field().lcor(queries(), tolerance=tolerance)
    assert (answer.half_width <= tolerance).all()
    assert (answer.half_width > 0).any()
    assert (np.abs(answer.values - exact.values) <= answer.half_width + 1e-6).mean() > 0.98
    assert answer.contributors.row.shape == (len(queries()), 0)
    ratio = answer.effective_sample_size / exact.effective_sample_size
    np.testing.assert_allclose(ratio, 1, atol=0.1)


def test_a_relative_tolerance_is_in_deviations_of_lcor():
    deviation = field().lcor(field().states[::200]).values.std()
    answer = field().lcor(queries(), tolerance=0.2, relative=True)
    assert (answer.half_width <= 0.2 * deviation * 1.2).all()
    assert answer.half_width.max() > 0.05 * deviation
    sharp = made_anew(alpha=8.0)
    assert sharp.lcor(queries(), tolerance=0.2, relative=True).half_width.max() > 0


@pytest.mark.parametrize("count", [1, 100, 255, 300])
def test_a_relative_tolerance_of_a_small_store_is_kept_by_using_all(count: int):
    whole = field()
    few = replace(
        whole,
        states=whole.states[:count].copy(),
        leverage=whole.leverage[:count],
        labeled=whole.labeled[:count],
    )
    answer = few.lcor(queries(), tolerance=0.1, relative=True)
    np.testing.assert_array_equal(answer.values, few.lcor(queries()).values)
    assert (answer.half_width == 0).all()


def test_the_deviation_of_lcor_is_that_of_exact_answers():
    for alpha in (1.0, 20.0):
        asked = made_anew(alpha=alpha)
        answer = asked.lcor(queries(), tolerance=0.3, relative=True)
        deviation = asked.lcor(field().states[::300]).values.std()
        assert answer.half_width.max() <= 0.3 * 1.2 * deviation


def test_seconds_are_answered_and_the_seed_decides_the_part():
    answer = field().lcor(queries(), seconds=1e-4)
    assert 0 < answer.half_width.max() < 0.2
    one, same, other = (field().lcor(queries(), tolerance=0.02, seed=s).values for s in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()


def test_a_mapped_file_answers_as_an_array_does(tmp_path: Path):
    np.save(tmp_path / "states.npy", field().states)
    mapped = np.load(tmp_path / "states.npy", mmap_mode="r")
    same = replace(field(), states=mapped)
    assert isinstance(same.states.base, np.memmap) or isinstance(same.states, np.memmap)
    for options in ({}, {"tolerance": 0.02}):
        np.testing.assert_array_equal(
            same.lcor(queries(), **options).values, field().lcor(queries(), **options).values
        )


def test_a_field_uses_the_threads_that_it_is_given():
    alone = made_anew(threads=1)
    for options in ({}, {"tolerance": 0.02}):
        np.testing.assert_allclose(
            alone.lcor(queries(), **options).values,
            field().lcor(queries(), **options).values,
            atol=1e-8,
        )
    with pytest.raises(InvalidInputError, match="threads: expected at least 1, found 0"):
        replace(field(), threads=0)
