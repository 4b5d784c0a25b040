"""Errors cross the wire and stay what they are."""

import pytest

import ssil_data as sd
from ssil_data.client.error_kinds import CALLER_KINDS, STATUS, caller_error, error_of_status
from ssil_service.problems import of_library

CALLERS = [sd.NotFoundError, sd.ConflictError, sd.InvalidInputError]


@pytest.mark.parametrize("kind", CALLERS)
def test_a_callers_mistake_is_the_same_error_on_both_sides(kind: type[sd.SsilDataError]):
    assert error_of_status(of_library(kind("what")).status) is kind
    found = caller_error(kind.__name__, "what")
    assert type(found) is kind
    assert str(found) == "what"


def test_what_is_not_the_callers_mistake_has_no_kind():
    assert set(CALLER_KINDS.values()) == set(CALLERS)
    assert STATUS[sd.DamagedError] == 500
    assert error_of_status(500) is None
    assert caller_error("DamagedError", "what") is None
    assert caller_error("CrashError", "what") is None
    assert of_library(sd.SsilDataError("what")).status == 500
