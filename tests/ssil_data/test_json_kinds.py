"""Whatever stands where a JSON object of a kind should: it is read, or refused by one message."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssil_data import estimators, pooling, scales
from ssil_data.errors import InvalidInputError
from ssil_data.json_kinds import shorten, show_short
from ssil_data.pooling import FittedPooling, HiddenMarkov, Window
from ssil_data.pooling.window import WIDEST, FittedWindow
from ssil_data.ranks import KNOTS
from ssil_data.scales import FittedScale

CHANCE = {
    "kind": "chance",
    "uncertainty": [0.0, 1.0],
    "chance": [1.0, 0.0],
    "expert_share": 0.5,
    "interval": [0.4, 0.6],
}
READERS: dict[str, tuple[Callable[[Any], Any], list[dict[str, Any]]]] = {
    "estimator": (
        estimators.from_json,
        [estimators.to_json(each()) for each in estimators.ESTIMATORS.values()],
    ),
    "scale": (
        scales.settings_from_json,
        [scales.to_json(each()) for each in scales.SCALES.values()],
    ),
    "fitted scale": (
        scales.from_json,
        [
            CHANCE,
            {"kind": "ramp", "low": 0.0, "high": 1.0},
            {"kind": "rank", "residuals": [0.0]},
        ],
    ),
    "pooling": (
        pooling.settings_from_json,
        [pooling.to_json(each()) for each in pooling.POOLINGS.values()],
    ),
    "fitted pooling": (
        pooling.from_json,
        [
            {"kind": "window", "half_width": 25, "knots": [0.0] * KNOTS},
            {"kind": "hmm", "edges": [0.0], "log_ratio": [1.0, 0.0], "stay": 0.9, "share": 0.5},
        ],
    ),
}
CASES = [(name, value) for name, (_, values) in READERS.items() for value in values]
FIELDS = [(name, value, key) for name, value in CASES for key in value if key != "kind"]
HUGE: list[Any] = [10**400, 10**4000, -(10**400), 1e400, -1e400, float("nan")]
ANY = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.sampled_from(HUGE),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=5,
)


@pytest.mark.parametrize(("name", "value"), CASES)
def test_an_object_is_read_as_it_stands_in_a_file(name: str, value: dict[str, Any]):
    assert READERS[name][0](json.loads(json.dumps(value))).kind == value["kind"]


@pytest.mark.parametrize(
    "wrong", [None, [], [1], "window", "", 3, 1e400, 10**5000, True], ids=show_short
)
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_object_is_refused_with_the_kinds_that_there_are(name: str, wrong: Any):
    with pytest.raises(InvalidInputError, match=f"^{name}: expected a JSON object .*, found "):
        READERS[name][0](wrong)


@pytest.mark.parametrize(
    "kind", [None, "median", ["window"], {}, 10**5000, float("nan")], ids=show_short
)
@pytest.mark.parametrize("name", READERS)
def test_an_unknown_kind_is_refused(name: str, kind: Any):
    with pytest.raises(InvalidInputError, match=f"^{name}: kind: expected one of .*, found "):
        READERS[name][0]({"kind": kind})


@pytest.mark.parametrize(("name", "value"), CASES)
def test_an_unknown_key_is_refused_even_if_it_is_no_text(name: str, value: dict[str, Any]):
    for key in ("more", 3, None):
        with pytest.raises(InvalidInputError, match=f"^{value['kind']}: expected keys of"):
            READERS[name][0]({**value, key: 1})


@pytest.mark.parametrize(("name", "value", "key"), FIELDS)
@pytest.mark.parametrize(
    "wrong", [*HUGE, "0.5", {}, [None], [10**400], [float("inf")], [[1.0]]], ids=show_short
)
def test_a_value_that_is_no_such_number_is_one_message_with_its_name(
    name: str, value: dict[str, Any], key: str, wrong: Any
):
    with pytest.raises(InvalidInputError, match=rf"^(\w+: )?{key}: expected .*found ") as caught:
        READERS[name][0]({**value, key: wrong})
    assert len(str(caught.value)) < 500


@given(st.sampled_from(FIELDS), ANY)
def test_any_value_is_read_or_refused(case: tuple[str, dict[str, Any], str], wrong: Any):
    name, value, key = case
    try:
        READERS[name][0]({**value, key: wrong})
    except InvalidInputError as error:
        assert str(error)


def test_a_key_of_a_fitted_value_that_is_missing_is_named():
    with pytest.raises(InvalidInputError, match=r"^ramp: high: missing in the fitted scale$"):
        scales.from_json({"kind": "ramp", "low": 0.0})


def test_a_float32_that_is_too_large_is_refused_without_a_warning():
    with pytest.raises(InvalidInputError, match="rising knots"):
        pooling.from_json({"kind": "window", "half_width": 25, "knots": [1e39] * KNOTS})


@pytest.mark.parametrize("width", [0, WIDEST + 1, 10**400, 2.0, True, "25", None])
def test_a_window_is_from_one_to_the_widest(width: Any):
    with pytest.raises(InvalidInputError, match="half_width: expected a whole number from 1 to"):
        Window(width)
    assert Window(WIDEST).half_width == WIDEST


def test_too_many_bins_are_refused():
    with pytest.raises(InvalidInputError, match="bins: expected a whole number from 2 to 1,024"):
        HiddenMarkov(bins=1025)


@given(st.lists(st.floats(width=32, allow_nan=False, allow_infinity=False), max_size=20))
def test_short_decimals_are_the_same_float32(values: list[float]):
    numbers = np.array(values, np.float32)
    short = json.loads(json.dumps(shorten(numbers)))
    np.testing.assert_array_equal(np.array(short, np.float32), numbers)
    assert shorten(np.array(short, np.float32)) == tuple(short)
    assert all(float(f"{each:.9g}") == each for each in short)


def test_a_record_with_long_decimals_is_read_as_the_same_pooling():
    random = np.random.default_rng(0)
    values = random.normal(size=400).astype(np.float32)
    episode = np.repeat([0, 1], 200)
    fitted = Window().fit(values, episode)
    stored = pooling.to_json(fitted)
    old = {**stored, "knots": [float(np.float32(knot)) for knot in stored["knots"]]}
    assert len(json.dumps(old)) > 1.5 * len(json.dumps(stored))
    read = pooling.from_json(old)
    assert read == fitted
    np.testing.assert_array_equal(read(values, episode), fitted(values, episode))


def test_fitted_values_are_of_the_kind_that_was_read():
    assert isinstance(scales.from_json(CHANCE), FittedScale)
    window = pooling.from_json({"kind": "window", "half_width": 0, "knots": [0.0] * KNOTS})
    assert isinstance(window, FittedPooling) and isinstance(window, FittedWindow)


def test_what_is_shown_of_a_value_is_short():
    deep: list[Any] = []
    for _ in range(10_000):
        deep = [deep]
    for value in (10**5000, [10**5000], "a" * 10_000, deep, dict.fromkeys(range(10_000))):
        assert len(show_short(value)) < 200
