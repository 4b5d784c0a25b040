"""Fields over the same arrays share an engine; others share nothing."""

import copy
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest

from ssil_data import InvalidInputError, LeverageField
from ssil_data.demonstrations import finite_matrix
from ssil_data.features import Standardizer
from support.leverage_fields import field, made_anew, queries


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


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy])
def test_a_field_can_be_copied_after_a_query(copied):
    whole = field()
    few = LeverageField(
        whole.states[:50], whole.leverage[:50], whole.labeled[:50], whole.standardizer, 2.0
    )
    before = few.lcor(queries()).values
    np.testing.assert_array_equal(copied(few).lcor(queries()).values, before)


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
