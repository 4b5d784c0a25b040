"""A field asked to a tolerance or for a time: what it says of its own exactness, and refusals."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ssil_data import Accuracy, InvalidInputError, LeverageField
from ssil_data.features import Standardiser

STORE = 80_000


@cache
def field() -> LeverageField:
    rng = np.random.default_rng(0)
    states = (rng.normal(size=(STORE, 6)) * [1, 2, 3, 4, 5, 6] + 100).astype(np.float32)
    leverage = (1 / (1 + np.exp(100 - states[:, 0]))).astype(np.float32)
    labeled = np.arange(STORE) < 100
    return LeverageField(states, leverage, labeled, Standardiser.of(states), 2.0)


def queries() -> np.ndarray:
    return field().states[:: STORE // 200] + np.float32(0.2)


def test_without_accuracy_answers_are_exact():
    answer = field().lcor(queries())
    assert (answer.half_width == 0).all()
    sums = field().sums(queries())
    np.testing.assert_array_equal(answer.values, sums.values)


@pytest.mark.parametrize("tolerance", [0.02, 0.004])
def test_answers_to_a_tolerance_lie_within_it(tolerance: float):
    exact, answer = field().lcor(queries()), field().lcor(queries(), tolerance=tolerance)
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
    sharp = replace(field(), alpha=8.0)
    assert sharp.lcor(queries(), tolerance=0.2, relative=True).half_width.max() > 0


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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 0.0}, "tolerance: expected a finite number > 0, found 0.0"),
        ({"tolerance": np.nan}, "tolerance: expected a finite number > 0, found nan"),
        ({"seconds": -1.0}, "seconds: expected a finite number > 0, found -1.0"),
        ({"seconds": 1.0, "tolerance": 0.1}, "expected a tolerance or seconds, found both"),
        ({"relative": True}, "relative: expected a tolerance with it, found none"),
        ({"tolerance": 0.1, "seed": -1}, "seed: expected at least 0, found -1"),
        ({"tolerance": 0.1, "contributors": 2}, "contributors: expected 0 with a tolerance"),
    ],
)
def test_contradictions_are_refused(options: dict, message: str):
    with pytest.raises(InvalidInputError, match=re.escape(message)):
        field().lcor(queries(), **options)


def test_accuracy_is_checked_once_for_everybody():
    assert Accuracy().exact
    assert not Accuracy(tolerance=0.1).exact
    with pytest.raises(InvalidInputError, match="found both"):
        Accuracy(tolerance=0.1, seconds=1.0)


def test_a_device_that_torch_lacks_is_refused():
    with pytest.raises(InvalidInputError, match="device: expected one that torch can use"):
        replace(field(), device="nonsense").lcor(queries())
