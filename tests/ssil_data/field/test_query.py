"""The options of a query are validated once, and are the keyword arguments of lcor."""

import re
from dataclasses import fields
from typing import get_type_hints

import numpy as np
import pytest

from ssil_data import Accuracy, InvalidInputError
from ssil_data.field import LCoROptions, LCoRQuery
from support.leverage_fields import field, queries


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


def test_accuracy_is_validated_where_it_is_made():
    assert Accuracy().exact
    assert not Accuracy(tolerance=0.1).exact
    with pytest.raises(InvalidInputError, match="not both"):
        Accuracy(tolerance=0.1, seconds=1.0)


def test_numbers_of_numpy_become_pythons():
    query = LCoRQuery(tolerance=np.float32(0.5), seed=np.int64(3))  # pyright: ignore
    assert query == LCoRQuery(tolerance=0.5, seed=3)
    assert [type(each) for each in (query.tolerance, query.seed)] == [float, int]
    assert type(LCoRQuery(contributors=np.int32(2)).contributors) is int  # pyright: ignore
    assert type(Accuracy(seconds=np.float64(2)).seconds) is float


def test_the_keyword_arguments_of_lcor_are_the_fields_of_its_query():
    declared = get_type_hints(LCoRQuery)
    assert get_type_hints(LCoROptions) == declared
    assert {each.name for each in fields(LCoRQuery)} == set(declared)
    with pytest.raises(TypeError, match="tolerence"):
        field().lcor(queries(), tolerence=0.1)  # pyright: ignore[reportCallIssue]
