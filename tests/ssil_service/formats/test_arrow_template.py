"""Bodies of a known form give the numbers that reading them whole gives, and no others."""

from collections.abc import Callable

import httpx
import numpy as np
import pyarrow as pa
import pytest

from ssil_data.client.wire import ARROW, encode, states_table
from ssil_service.formats.arrow_template import ArrowTemplates

COR = "v1/datasets/drives/runs/vae/cor"


def body_of(states: np.ndarray) -> bytes:
    """Return states as clients send them."""
    return encode(states_table(states)).to_pybytes()


def numbers_in(body: bytes) -> np.ndarray:
    """Return the numbers of a body as Arrow finds them, uncopied."""
    column = pa.ipc.open_stream(body).read_all()["state"].chunk(0)
    return column.flatten().to_numpy().reshape(len(column), -1)


def test_a_body_of_a_known_form_has_the_numbers_that_arrow_finds(states: np.ndarray):
    forms = ArrowTemplates()
    first, second = body_of(states), body_of(states[::-1])
    assert forms.numbers(first, 3) is None
    forms.learn(first, numbers_in(first), 3)
    for body in (first, second):
        found = forms.numbers(body, 3)
        assert found is not None and found.dtype == np.float32
        assert not found.flags.writeable
        np.testing.assert_array_equal(found, numbers_in(body))
    assert forms.numbers(second, 4) is None  # asked under other conditions
    assert forms.numbers(body_of(states[:5]), 3) is None


def test_any_byte_beside_the_numbers_makes_another_form(states: np.ndarray):
    forms, body = ArrowTemplates(), body_of(states)
    forms.learn(body, numbers_in(body))
    first = body.index(states.tobytes())
    among = range(first, first + states.nbytes)
    for place in range(len(body)):
        other = body[:place] + bytes([body[place] ^ 1]) + body[place + 1 :]
        assert (forms.numbers(other) is not None) == (place in among)


def test_numbers_that_were_copied_teach_nothing(states: np.ndarray):
    forms, body = ArrowTemplates(), body_of(states)
    forms.learn(body, numbers_in(body).copy())
    assert forms.numbers(body) is None
    empty = body_of(states[:0])
    forms.learn(empty, np.frombuffer(empty, np.float32, 0).reshape(0, 3))
    assert forms.numbers(empty) is None


def test_so_many_forms_are_remembered_and_only_short_ones(states: np.ndarray):
    forms, body = ArrowTemplates(), body_of(states)
    noted = states_table(states).append_column("note", [["x" * 300] * len(states)])
    long = encode(noted).to_pybytes()
    forms.learn(long, numbers_in(long))
    assert not forms._known
    for condition in range(1000):
        forms.learn(body, numbers_in(body), condition)
        assert len(forms._known) <= 256


def _nan(states: np.ndarray) -> bytes:
    return body_of(np.where(np.arange(3) == 1, np.nan, states).astype(np.float32))


def _narrow(states: np.ndarray) -> bytes:
    return body_of(np.ascontiguousarray(states.reshape(-1, 2)))


@pytest.mark.parametrize("spoil", [_nan, _narrow, lambda states: body_of(states)[:-30]])
def test_bad_bodies_are_refused_though_the_form_is_known(
    spoil: Callable[[np.ndarray], bytes], asked: httpx.Client, states: np.ndarray
):
    headers = {"Content-Type": ARROW}
    before = asked.post(COR, content=spoil(states), headers=headers)
    answers = [asked.post(COR, content=body_of(states), headers=headers) for _ in range(3)]
    assert len({answer.content for answer in answers}) == 1
    assert answers[0].status_code == 200
    after = asked.post(COR, content=spoil(states), headers=headers)
    assert before.status_code == after.status_code == 422
    assert before.content == after.content
