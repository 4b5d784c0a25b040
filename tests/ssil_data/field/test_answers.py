"""A field asked to a tolerance or for a time: what it says of its own exactness, and refusals."""

import copy
import pickle
import re
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest

from ssil_data import Accuracy, InvalidInputError, LeverageField
from ssil_data.demonstrations import finite_matrix
from ssil_data.features import Standardizer
from ssil_data.field import LCoROptions, LCoRQuery

STORE = 80_000


@cache
def field() -> LeverageField:
    rng = np.random.default_rng(0)
    states = (rng.normal(size=(STORE, 6)) * [1, 2, 3, 4, 5, 6] + 100).astype(np.float32)
    leverage = (1 / (1 + np.exp(100 - states[:, 0]))).astype(np.float32)
    labeled = np.arange(STORE) < 100
    return LeverageField(states, leverage, labeled, Standardizer.of(states), 2.0)


def made_anew(**changes: Any) -> LeverageField:
    """The field with other values, that shares nothing with it."""
    return replace(field(), **changes, engine=None)


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
    sharp = made_anew(alpha=8.0)
    assert sharp.lcor(queries(), tolerance=0.2, relative=True).half_width.max() > 0


@pytest.mark.parametrize("count", [1, 100, 255, 300])
def test_a_relative_tolerance_of_a_small_store_is_kept_by_asking_all(count: int):
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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 0.0}, "tolerance: expected a finite number > 0, found 0.0"),
        ({"tolerance": np.nan}, "tolerance: expected a finite number > 0, found nan"),
        ({"seconds": -1.0}, "seconds: expected a finite number > 0, found -1.0"),
        ({"seconds": 1.0, "tolerance": 0.1}, "accuracy: give a tolerance or seconds, not both"),
        ({"relative": True}, "relative: give the tolerance that it scales as well"),
        ({"tolerance": 0.1, "seed": -1}, "seed: expected at least 0, found -1"),
        ({"seed": 3}, "seed: only sampling uses it, which needs a tolerance or seconds as well"),
        ({"tolerance": 0.1, "contributors": 2}, "contributors: expected 0 with a tolerance"),
    ],
)
def test_contradictions_are_refused(options: dict, message: str):
    with pytest.raises(InvalidInputError, match=re.escape(message)):
        field().lcor(queries(), **options)


def test_accuracy_is_checked_once_for_everybody():
    assert Accuracy().exact
    assert not Accuracy(tolerance=0.1).exact
    with pytest.raises(InvalidInputError, match="not both"):
        Accuracy(tolerance=0.1, seconds=1.0)


def test_another_alpha_shares_what_is_packed():
    first = field().lcor(queries(), tolerance=0.02).values
    other = field().at(20.0)
    np.testing.assert_array_equal(
        other.lcor(queries()).values, made_anew(alpha=20.0).lcor(queries()).values
    )
    assert other.engine is not None and other.engine is field().engine
    assert other.engine.references() is replace(field(), alpha=3.0).engine.references()
    np.testing.assert_array_equal(field().lcor(queries(), tolerance=0.02).values, first)
    with pytest.raises(InvalidInputError, match="alpha: expected a finite number > 0"):
        field().at(-1.0)


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


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy])
def test_a_field_can_be_copied_after_it_was_asked(copied):
    whole = field()
    few = LeverageField(
        whole.states[:50], whole.leverage[:50], whole.labeled[:50], whole.standardizer, 2.0
    )
    before = few.lcor(queries()).values
    np.testing.assert_array_equal(copied(few).lcor(queries()).values, before)


@pytest.mark.parametrize(
    ("leverage", "message"),
    [
        (np.array([0.5, np.nan]), "leverage: expected finite float32 numbers, found nan at row 1"),
        (np.array([0.5, 1.5]), "leverage: expected numbers from 0 to 1, found 1.5 at row 1"),
        (np.array([-0.1, 0.5]), "leverage: expected numbers from 0 to 1, found -0.1"),
        (np.array([[0.5], [0.5]]), "leverage: expected one dimension, found shape (2, 1)"),
        (np.array([0.5]), "leverage: expected one per state, found shape (1,) for 2 states"),
    ],
)
def test_leverages_that_are_none_are_refused(leverage: np.ndarray, message: str):
    states = field().states[:2]
    with pytest.raises(InvalidInputError, match=re.escape(message)):
        LeverageField(states, leverage, np.array([True, False]), field().standardizer, 1.0)


def test_a_view_of_what_can_be_written_is_copied():
    written = field().states[:10].copy()
    view = written[:]
    view.flags.writeable = False
    kept = finite_matrix("states", view)
    written[:] = np.nan
    assert np.isfinite(kept).all()


def test_a_device_that_torch_lacks_is_refused():
    with pytest.raises(InvalidInputError, match="device: torch cannot use 'nonsense': "):
        replace(field(), device="nonsense").lcor(queries())


@pytest.mark.parametrize("name", ["states", "leverage", "labeled", "standardizer"])
def test_a_field_over_other_arrays_shares_nothing(name: str):
    whole = field()
    changed = {
        "states": whole.states + np.float32(1),
        "leverage": 1 - whole.leverage,
        "labeled": ~whole.labeled,
        "standardizer": Standardizer.of(whole.states * 2),
    }
    other = replace(whole, **{name: changed[name]})
    assert other.engine is not whole.engine
    found = other.lcor(queries()[:3]).values, other.cor(queries()[:3])
    expected = made_anew(**{name: changed[name]})
    np.testing.assert_array_equal(found[0], expected.lcor(queries()[:3]).values)
    np.testing.assert_array_equal(found[1], expected.cor(queries()[:3]))
    assert (found[0] != whole.lcor(queries()[:3]).values).any() or name == "labeled"


def test_a_pickled_field_is_its_values_without_what_was_packed():
    few = LeverageField(
        field().states[:50], field().leverage[:50], field().labeled[:50], field().standardizer, 2.0
    )
    few.lcor(queries())
    data = pickle.dumps(few)
    again = pickle.loads(data)  # noqa: S301  our own bytes
    assert again.engine is not few.engine
    assert not again.states.flags.writeable
    assert len(data) < 3 * few.states.nbytes
    np.testing.assert_array_equal(again.lcor(queries()).values, few.lcor(queries()).values)


def test_the_keyword_arguments_of_lcor_are_the_fields_of_its_query():
    declared = get_type_hints(LCoRQuery)
    assert get_type_hints(LCoROptions) == declared
    assert {each.name for each in fields(LCoRQuery)} == set(declared)
    with pytest.raises(TypeError, match="tolerence"):
        field().lcor(queries(), tolerence=0.1)  # pyright: ignore[reportCallIssue]
