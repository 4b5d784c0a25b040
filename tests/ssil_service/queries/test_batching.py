"""Small queries computed together: each gets the answer that it has alone, and nothing else."""

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


class RecordingField:
    """A field that records how many states each call had."""

    def __init__(self, field: Any) -> None:
        self._field = field
        self.states = field.states
        self.alpha = field.alpha
        self.rows: list[int] = []

    def lcor(self, states: np.ndarray) -> Any:
        self.rows.append(len(states))
        return self._field.lcor(states)


class FailingField(RecordingField):
    """A field whose engine fails."""

    def lcor(self, states: np.ndarray) -> Any:
        super().lcor(states)
        raise MemoryError("no more")


@pytest.fixture(scope="module")
def field(scored: Any) -> Any:
    return sd.Store(scored)["drives"].field("vae")


@pytest.fixture
def queries() -> list[np.ndarray]:
    """Queries of none to four states, some of them far from everything."""
    rng = np.random.default_rng(0)
    some = [rng.normal((10, 100, 0), size=(n % 5, 3)).astype(np.float32) for n in range(40)]
    some[7][1] = (3e38, -3e38, 0)
    return some


def assert_same_bits(found: Any, expected: Any) -> None:
    for name in ("values", "effective_sample_size", "half_width"):
        assert getattr(found, name).tobytes() == getattr(expected, name).tobytes()
    assert found.contributors.row.shape == expected.contributors.row.shape


def answers(queries: list[np.ndarray], recording: Any, most: int = 2**21) -> list[Any]:
    """Return the answers to queries of one round of the loop."""

    async def run() -> list[Any]:
        batching = Batching(most)
        each = (batching.lcor(recording, states) for states in queries)
        return await asyncio.gather(*each, return_exceptions=True)

    return asyncio.run(run())


def test_queries_of_one_round_are_computed_together_and_keep_their_bits(
    field: Any, queries: list[np.ndarray]
):
    recording = RecordingField(field)
    for found, states in zip(answers(queries, recording), queries, strict=True):
        assert_same_bits(found, field.lcor(states))
    assert recording.rows == [sum(map(len, queries))]


def test_a_batch_is_never_larger_than_the_limit(field: Any, queries: list[np.ndarray]):
    recording = RecordingField(field)
    found = answers(queries, recording, most=10 * len(field.states))
    for each, states in zip(found, queries, strict=True):
        assert_same_bits(each, field.lcor(states))
    assert max(recording.rows) <= 10 and sum(recording.rows) == sum(map(len, queries))
    assert len(recording.rows) < len(queries) / 2


def test_cancelled_queries_are_left_out_of_the_batch(field: Any, queries: list[np.ndarray]):
    recording = RecordingField(field)

    async def run() -> list[Any]:
        batching = Batching(2**21)
        tasks = [asyncio.ensure_future(batching.lcor(recording, q)) for q in queries]
        asyncio.get_running_loop().call_soon(tasks[4].cancel)
        return await asyncio.gather(*tasks, return_exceptions=True)

    found = asyncio.run(run())
    assert isinstance(found[4], asyncio.CancelledError) and len(queries[4]) == 4
    assert recording.rows == [sum(map(len, queries)) - 4]
    for number in (0, 3, 5, 39):
        assert_same_bits(found[number], field.lcor(queries[number]))


def test_an_error_reaches_every_query_of_its_batch_and_no_other(
    field: Any, queries: list[np.ndarray]
):
    broken = FailingField(field)
    whole = RecordingField(field)

    async def run() -> tuple[list[Any], list[Any], Any]:
        batching = Batching(2**21)
        first = [asyncio.ensure_future(batching.lcor(broken, q)) for q in queries[:9]]  # pyright: ignore[reportArgumentType]
        second = [asyncio.ensure_future(batching.lcor(whole, q)) for q in queries[:9]]  # pyright: ignore[reportArgumentType]
        faults = await asyncio.gather(*first, return_exceptions=True)
        rest = await asyncio.gather(*second)
        return faults, rest, await batching.lcor(field, queries[1])

    faults, rest, later = asyncio.run(run())
    assert [str(fault) for fault in faults] == ["no more"] * 9
    for found, states in zip([*rest, later], [*queries[:9], queries[1]], strict=True):
        assert_same_bits(found, field.lcor(states))
    assert len(broken.rows) == len(whole.rows) == 1


def test_kernels_whose_bits_depend_on_the_batch_compute_each_query_alone(
    field: Any, queries: list[np.ndarray]
):
    flat = RecordingField(field.at(references.MIN_COMPILED_ALPHA / 2))
    for found, states in zip(answers(queries, flat), queries, strict=True):
        assert_same_bits(found, field.at(flat.alpha).lcor(states))
    assert flat.rows == [len(states) for states in queries]


def test_concurrent_clients_get_the_local_bits(
    remote: RemoteStore, local: sd.Store, queries: list[np.ndarray]
):
    there = remote["drives"].field("vae")
    here = local["drives"].field("vae")
    with ThreadPoolExecutor(16) as clients:
        found = list(clients.map(there.lcor, queries * 5))
    for each, states in zip(found, queries * 5, strict=True):
        assert_same_bits(each, here.lcor(states))


def test_an_error_of_the_engine_is_500_and_later_queries_succeed(
    http: httpx.Client, monkeypatch: pytest.MonkeyPatch
):
    def broken(*_: Any, **__: Any) -> Any:
        raise MemoryError("no more")

    url = "v1/datasets/drives/runs/vae/lcor"
    body = {"states": [[1.0, 2.0, 3.0]]}
    assert http.post(url, json=body).status_code == 200
    with monkeypatch.context() as patched:
        patched.setattr("ssil_data.field.leverage_field.LeverageField.lcor", broken)
        assert http.post(url, json=body).status_code == 500
    assert http.post(url, json=body).status_code == 200
