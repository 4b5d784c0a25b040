"""Bodies like an earlier one give the numbers that Arrow finds in them, and no others."""

from collections.abc import Callable

import httpx
import numpy as np
import pyarrow as pa
import pytest

from ssil_data.client.wire import ARROW, encode, states_table
from ssil_service.formats.arrow_template import MOST_TEMPLATES, ArrowTemplates

COR = "v1/datasets/drives/runs/vae/cor"


def body_of(states: np.ndarray) -> bytes:
    """Return states as clients send them."""
    return encode(states_table(states)).to_pybytes()


def numbers_in(body: bytes) -> np.ndarray:
    """Return the numbers of a body as Arrow finds them, uncopied."""
    column = pa.ipc.open_stream(body).read_all()["state"].chunk(0)
    return column.flatten().to_numpy().reshape(len(column), -1)


def test_a_body_like_an_earlier_one_has_the_numbers_that_arrow_finds(states: np.ndarray):
    templates = ArrowTemplates()
    first = body_of(states)
    second = body_of(states[::-1])
    assert templates.numbers(first, 3) is None
    templates.add(first, numbers_in(first), 3)
    for body in (first, second):
        found = templates.numbers(body, 3)
        assert found is not None and found.dtype == np.float32
        assert not found.flags.writeable
        np.testing.assert_array_equal(found, numbers_in(body))
    assert templates.numbers(second, 4) is None  # under other conditions
    assert templates.numbers(body_of(states[:5]), 3) is None


def test_any_other_byte_around_the_numbers_needs_another_template(states: np.ndarray):
    templates = ArrowTemplates()
    body = body_of(states)
    templates.add(body, numbers_in(body))
    first = body.index(states.tobytes())
    among = range(first, first + states.nbytes)
    for place in range(len(body)):
        other = body[:place] + bytes([body[place] ^ 1]) + body[place + 1 :]
        assert (templates.numbers(other) is not None) == (place in among)


def test_copied_numbers_and_empty_bodies_make_no_template(states: np.ndarray):
    templates = ArrowTemplates()
    body = body_of(states)
    templates.add(body, numbers_in(body).copy())
    assert templates.numbers(body) is None
    empty = body_of(states[:0])
    templates.add(empty, np.frombuffer(empty, np.float32, 0).reshape(0, 3))
    assert templates.numbers(empty) is None


def test_templates_are_bounded_in_number_and_length(states: np.ndarray):
    templates = ArrowTemplates()
    body = body_of(states)
    noted = states_table(states).append_column("note", [["x" * 300] * len(states)])
    long = encode(noted).to_pybytes()
    templates.add(long, numbers_in(long))
    assert len(templates) == 0
    for condition in range(1000):
        templates.add(body, numbers_in(body), condition)
        assert 0 < len(templates) <= MOST_TEMPLATES


def _nan(states: np.ndarray) -> bytes:
    return body_of(np.where(np.arange(3) == 1, np.nan, states).astype(np.float32))


def _narrow(states: np.ndarray) -> bytes:
    return body_of(np.ascontiguousarray(states.reshape(-1, 2)))


@pytest.mark.parametrize("spoil", [_nan, _narrow, lambda states: body_of(states)[:-30]])
def test_bad_bodies_are_refused_after_good_ones_of_the_same_shape(
    spoil: Callable[[np.ndarray], bytes], shared_http: httpx.Client, states: np.ndarray
):
    headers = {"Content-Type": ARROW}
    before = shared_http.post(COR, content=spoil(states), headers=headers)
    answers = [shared_http.post(COR, content=body_of(states), headers=headers) for _ in range(3)]
    assert len({answer.content for answer in answers}) == 1
    assert answers[0].status_code == 200
    after = shared_http.post(COR, content=spoil(states), headers=headers)
    assert before.status_code == after.status_code == 422
    assert before.content == after.content
