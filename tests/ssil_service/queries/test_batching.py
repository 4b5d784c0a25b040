"""Small questions asked together: each gets the answer that it has alone, and nothing else."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import numpy as np
import pytest

import ssil_data as sd
from ssil_data.client import RemoteStore
from ssil_data.kernels import references
from ssil_service.queries.batching import Batching


class Asked:
    """A field that remembers how many states it was asked at once."""

    def __init__(self, field: Any) -> None:
        self._field = field
        self.states, self.alpha = field.states, field.alpha
        self.rows: list[int] = []

    def lcor(self, states: np.ndarray) -> Any:
        self.rows.append(len(states))
        return self._field.lcor(states)


class Broken(Asked):
    """A field whose engine fails."""

    def lcor(self, states: np.ndarray) -> Any:
        super().lcor(states)
        raise MemoryError("no more")


@pytest.fixture(scope="module")
def field(scored: Any) -> Any:
    return sd.Store(scored)["drives"].field("vae")


@pytest.fixture
def questions() -> list[np.ndarray]:
    """Questions of none to four states, some of them far from everything."""
    rng = np.random.default_rng(0)
    some = [rng.normal((10, 100, 0), size=(n % 5, 3)).astype(np.float32) for n in range(40)]
    some[7][1] = (3e38, -3e38, 0)
    return some


def assert_same_bits(found: Any, expected: Any) -> None:
    for name in ("values", "effective_sample_size", "half_width"):
        assert getattr(found, name).tobytes() == getattr(expected, name).tobytes()
    assert found.contributors.row.shape == expected.contributors.row.shape


def answers(questions: list[np.ndarray], asked: Any, most: int = 2**21) -> list[Any]:
    """Return the answers to questions asked in one round of the loop."""

    async def ask() -> list[Any]:
        batching = Batching(most)
        each = (batching.lcor(asked, states) for states in questions)
        return await asyncio.gather(*each, return_exceptions=True)

    return asyncio.run(ask())


def test_questions_of_one_round_are_asked_together_and_have_their_own_bits(
    field: Any, questions: list[np.ndarray]
):
    asked = Asked(field)
    for found, states in zip(answers(questions, asked), questions, strict=True):
        assert_same_bits(found, field.lcor(states))
    assert asked.rows == [sum(map(len, questions))]


def test_no_more_is_asked_together_than_the_loop_may_wait_for(
    field: Any, questions: list[np.ndarray]
):
    asked = Asked(field)
    found = answers(questions, asked, most=10 * len(field.states))
    for each, states in zip(found, questions, strict=True):
        assert_same_bits(each, field.lcor(states))
    assert max(asked.rows) <= 10 and sum(asked.rows) == sum(map(len, questions))
    assert len(asked.rows) < len(questions) / 2


def test_who_has_gone_is_not_computed_for_and_does_no_harm(field: Any, questions: list[np.ndarray]):
    asked = Asked(field)

    async def ask() -> list[Any]:
        batching = Batching(2**21)
        tasks = [asyncio.ensure_future(batching.lcor(asked, q)) for q in questions]
        asyncio.get_running_loop().call_soon(tasks[4].cancel)
        return await asyncio.gather(*tasks, return_exceptions=True)

    found = asyncio.run(ask())
    assert isinstance(found[4], asyncio.CancelledError) and len(questions[4]) == 4
    assert asked.rows == [sum(map(len, questions)) - 4]
    for number in (0, 3, 5, 39):
        assert_same_bits(found[number], field.lcor(questions[number]))


def test_a_fault_reaches_all_of_its_batch_and_nobody_else(field: Any, questions: list[np.ndarray]):
    broken, whole = Broken(field), Asked(field)

    async def ask() -> tuple[list[Any], list[Any], Any]:
        batching = Batching(2**21)
        first = [asyncio.ensure_future(batching.lcor(broken, q)) for q in questions[:9]]  # pyright: ignore[reportArgumentType]
        second = [asyncio.ensure_future(batching.lcor(whole, q)) for q in questions[:9]]  # pyright: ignore[reportArgumentType]
        faults = await asyncio.gather(*first, return_exceptions=True)
        rest = await asyncio.gather(*second)
        return faults, rest, await batching.lcor(field, questions[1])

    faults, rest, later = asyncio.run(ask())
    assert [str(fault) for fault in faults] == ["no more"] * 9
    for found, states in zip([*rest, later], [*questions[:9], questions[1]], strict=True):
        assert_same_bits(found, field.lcor(states))
    assert len(broken.rows) == len(whole.rows) == 1


def test_where_bits_depend_on_the_batch_each_is_asked_alone(
    field: Any, questions: list[np.ndarray]
):
    flat = Asked(field.at(references.MIN_COMPILED_ALPHA / 2))
    for found, states in zip(answers(questions, flat), questions, strict=True):
        assert_same_bits(found, field.at(flat.alpha).lcor(states))
    assert flat.rows == [len(states) for states in questions]


def test_clients_that_ask_at_once_get_the_local_bits(
    remote: RemoteStore, local: sd.Store, questions: list[np.ndarray]
):
    there, here = remote["drives"].field("vae"), local["drives"].field("vae")
    with ThreadPoolExecutor(16) as clients:
        found = list(clients.map(there.lcor, questions * 5))
    for each, states in zip(found, questions * 5, strict=True):
        assert_same_bits(each, here.lcor(states))


def test_a_fault_of_the_engine_is_a_problem_for_who_asked(
    http: httpx.Client, monkeypatch: pytest.MonkeyPatch
):
    def broken(*_: Any, **__: Any) -> Any:
        raise MemoryError("no more")

    url, body = "v1/datasets/drives/runs/vae/lcor", {"states": [[1.0, 2.0, 3.0]]}
    assert http.post(url, json=body).status_code == 200
    with monkeypatch.context() as patched:
        patched.setattr("ssil_data.field.leverage_field.LeverageField.lcor", broken)
        assert http.post(url, json=body).status_code == 500
    assert http.post(url, json=body).status_code == 200
