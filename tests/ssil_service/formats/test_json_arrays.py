"""JSON numbers become the arrays that Python's own parser gives, and every fault has its place."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Raw
from numpy.testing import assert_array_equal

from ssil_service.formats.json_arrays import integers_from_json, matrix_from_json, read_object
from ssil_service.problems import Problem
from ssil_service.schemas.requests import PairsBody

NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False, width=32),
    st.floats(-1e30, 1e30),
    st.integers(-(10**30), 10**30),
)


def matrix(rows: Any, width: int = 3, most_rows: int = 10**6) -> np.ndarray:
    text = rows if isinstance(rows, bytes) else json.dumps(rows).encode()
    return matrix_from_json("states", Raw(text), width, most_rows=most_rows)


def fault(rows: Any, width: int = 3) -> Problem:
    with pytest.raises(Problem) as raised:
        matrix(rows, width)
    return raised.value


@given(st.lists(st.lists(NUMBERS, min_size=3, max_size=3), max_size=20))
def test_rows_have_the_bits_of_pythons_parser(rows: list[list[float]]):
    expected = np.array(json.loads(json.dumps(rows)), np.float64).reshape(-1, 3)
    assert_array_equal(matrix(rows), expected.astype(np.float32))


def test_digits_beyond_double_precision_are_rounded_as_python_rounds_them():
    text = b"[[0.1000000000000000055511151231257827, 1e-45, 3.4028234663852886e38]]"
    expected = np.array(json.loads(text)).astype(np.float32)
    assert_array_equal(matrix(text), expected)


@pytest.mark.parametrize(
    ("rows", "where"),
    [
        ([[1, 2, 3], [1, "2", 3], [None, 2, True]], [(1, 1), (2, 0), (2, 2)]),
        ([[1, 2, 3], [1, 2, [3]], [{}, 2, 3]], [(1, 2), (2, 0)]),
        ([[1e39, 2, 3]], [(0, 0)]),
        ([[10**400, 2, -(10**400)]], [(0, 0), (0, 2)]),
        (b"[[1, 2, 1e999]]", [(0, 2)]),
        ([[1, 2, 3], [1, 1e39, "x"]], [(1, 1), (1, 2)]),
    ],
)
def test_cells_that_are_no_float32_are_named(rows: Any, where: list[tuple[int, int]]):
    problem = fault(rows)
    assert problem.status == 422
    assert [(each.row, each.column) for each in problem.errors] == where
    assert "expected a finite float32 number" in problem.detail


@pytest.mark.parametrize(
    ("rows", "where", "found"),
    [
        ([[1, 2, 3], [1, 2], [1, 2, 3, 4]], [1, 2], "found 2"),
        ([[1, "x", 3], 7, [1]], [1, 2], "found no list"),
        ([{}], [0], "found no list"),
    ],
)
def test_rows_of_another_width_are_named_before_cells(rows: Any, where: list[int], found: str):
    problem = fault(rows)
    assert [each.row for each in problem.errors] == where
    assert f"expected width 3, {found} at row {where[0]}" in problem.detail


@pytest.mark.parametrize("value", [{}, 3, "text", None, True])
def test_what_is_no_list_of_rows_is_refused(value: Any):
    assert "expected a list of rows" in fault(value).detail


def test_a_hundred_faults_are_named_at_most():
    assert len(fault([["x"] * 3] * 200).errors) == 100
    assert len(fault([[1.0]] * 200).errors) == 100


def test_too_many_rows_are_413_whatever_is_in_them():
    for rows in ([[1, 2, 3]] * 11, ["x"] * 11):
        with pytest.raises(Problem, match="at most 10 rows, found 11") as raised:
            matrix(rows, most_rows=10)
        assert raised.value.status == 413


@given(st.lists(st.integers(-(2**63), 2**63 - 1), max_size=20))
def test_integers_are_read_exactly(values: list[int]):
    found = integers_from_json("episode", Raw(json.dumps(values).encode()))
    assert found.dtype == np.int64 and found.tolist() == values


def test_whole_floats_are_integers_and_others_are_named():
    found = integers_from_json("step", Raw(b"[1, 3.0, -0.0, 1e3]"))
    assert found.tolist() == [1, 3, 0, 1000]
    with pytest.raises(Problem) as raised:
        integers_from_json("step", Raw(b'[1, 1.5, "2", 9223372036854775808, true, null, []]'))
    assert [each.row for each in raised.value.errors] == [1, 2, 3, 4, 5, 6]
    with pytest.raises(Problem, match="a list of integers"):
        integers_from_json("step", Raw(b"7"))


@pytest.mark.parametrize(
    ("body", "detail"),
    [
        (b"", "Invalid JSON"),
        (b'{"states": [NaN]}', "Invalid JSON"),
        (b'{"states": []} more', "Invalid JSON"),
        (b"[" * 10**6, "not a JSON object"),
        (b'{"states": %s}' % (b"[" * 10**6), "Invalid JSON"),
        (b'{"\xff": 1}', "Invalid JSON"),
        (b"[1]", "not a JSON object"),
        (b'{"states": []}', "actions: Field required"),
        (b'{"states": [], "actions": [], "other": 1}', "other: Extra inputs are not permitted"),
    ],
)
def test_bodies_that_are_no_object_of_these_fields_are_refused(body: bytes, detail: str):
    with pytest.raises(Problem) as raised:
        read_object(body, PairsBody)
    assert raised.value.status == 422 and detail in raised.value.detail
