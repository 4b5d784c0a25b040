"""Long JSON: one thread reads and writes it, and the garbage collector has nothing to do."""

import asyncio
import gc
import json
import time
from collections.abc import Callable, Iterator
from threading import Lock
from typing import Any

import httpx
import numpy as np
import pytest

from ssil_data.client.wire import ARROW, JSON
from ssil_service import embed
from ssil_service.context import Context
from ssil_service.formats import inference_tensors as tensors
from ssil_service.formats.query_bodies import read_states
from ssil_service.problems import Problem
from ssil_service.queries.admission import BoundedExecutor
from ssil_service.routes.pages import most_rows
from ssil_service.settings import Settings

LCOR = "v1/datasets/drives/runs/vae/lcor"
INFER = "v2/models/drives.vae.lcor/infer"


def context_with(json_executor: BoundedExecutor) -> Context:
    """Return a context of which nothing but the executor for JSON is used."""
    other: Any = None
    return Context(Settings(), other, other, other, other, json_executor, other, other)


def test_long_json_is_read_and_written_one_at_a_time():
    busy = 0
    most = 0
    guard = Lock()

    def work() -> None:
        nonlocal busy, most
        with guard:
            busy += 1
            most = max(most, busy)
        time.sleep(0.01)
        with guard:
            busy -= 1

    async def crowd() -> list[Any]:
        here = context_with(BoundedExecutor(1, 3))
        conversions = [here.convert(2**20, work, JSON) for _ in range(6)]
        found = await asyncio.gather(*conversions, return_exceptions=True)
        here.json_executor.close(1)
        return found

    found = asyncio.run(crowd())
    assert most == 1
    assert [type(each) for each in found] == [type(None)] * 4 + [Problem] * 2


ROWS = 500_000
LONG = {
    "rows": b'{"states":[%s]}' % b",".join([b"[1,2,3]"] * ROWS),
    "empty rows": b'{"states":[%s]}' % b",".join([b"[]"] * ROWS),
    "rows in rows": b'{"states":[%s]}' % b",".join([b"[[],[],[]]"] * ROWS),
    "objects": b'{"states":[[%s]]}' % b",".join([b"{}"] * ROWS),
}
LISTS_OF_TENSORS = b'{"inputs":[{"name":"states","shape":[%d,3],"datatype":"FP32","data":[%s]}]}'


def full_collections(work: Callable[[], Any]) -> int:
    """Count how often the garbage collector goes through all objects during some work."""
    found: list[int] = []

    def note(phase: str, info: dict[str, int]) -> None:
        if phase == "start" and info["generation"] == 2:
            found.append(1)

    gc.collect()
    gc.callbacks.append(note)
    try:
        work()
    finally:
        gc.callbacks.remove(note)
    return len(found)


def test_the_garbage_collector_has_work_with_lists():
    assert gc.isenabled()
    assert full_collections(lambda: json.loads(LONG["rows"])) > 1


@pytest.mark.parametrize("name", LONG)
def test_long_json_makes_no_work_for_the_garbage_collector(name: str):
    def read() -> None:
        try:
            states = read_states(LONG[name], JSON, width=3, most_rows=ROWS)
            assert states.shape == (ROWS, 3)
        except Problem as problem:
            assert name != "rows" and problem.status == 422

    assert full_collections(read) <= 1


@pytest.mark.parametrize("row", [b"[1,2,3]", b"[[],{},[]]"])
def test_long_tensors_make_no_work_for_the_garbage_collector(row: bytes):
    body = LISTS_OF_TENSORS % (300_000, b",".join([row] * 300_000))

    def read() -> None:
        try:
            _, inputs = tensors.read(body, None, most_json=len(body))
            assert inputs["states"].shape == (300_000, 3)
        except Problem as problem:
            assert row != b"[1,2,3]" and problem.status == 422

    assert full_collections(read) <= 1


@pytest.fixture
def crowded(scored: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[httpx.Client]:
    """Start a service whose queue for long JSON is full, and to which all JSON is long."""
    monkeypatch.setattr("ssil_service.context.INLINE_BYTES", 0)
    with embed(scored, jobs=1) as store:
        http = store.connection.client
        transport: Any = http._transport
        transport.app.context().json_executor.admitted = 100
        yield http


def test_long_json_is_refused_when_the_queue_is_full(crowded: httpx.Client):
    body = {"states": [[1.0, 2.0, 3.0]]}
    tensor = {"name": "states", "datatype": "FP32", "shape": [1, 3], "data": [1, 2, 3]}
    for answer in (
        crowded.get("v1/datasets/drives/pairs"),
        crowded.get("v1/datasets/drives/episodes"),
        crowded.get("v1/datasets/drives/runs/vae/leverage"),
        crowded.post(LCOR, json=body),
        crowded.post(INFER, json={"inputs": [tensor]}),
    ):
        assert answer.status_code == 503
        assert int(answer.headers["retry-after"]) >= 1
    arrow = {"Accept": ARROW}
    assert crowded.get("v1/datasets/drives/pairs", headers=arrow).status_code == 200
    assert crowded.get("healthz").status_code == 200


def test_pages_of_json_are_short():
    assert most_rows(JSON, 32) == 4096
    assert most_rows(ARROW, 32) == 524_288


def test_an_inference_keeps_nothing_of_its_body_but_its_tensors():
    body = b"""{"id": "mine", "parameters": {"binary_data_output": true, "more": [[], []]},
        "inputs": [{"name": "states", "datatype": "FP32", "shape": [1, 2], "data": [1, 2]}],
        "outputs": [{"name": "values", "parameters": {"binary_data": true, "more": [[]]}}]}"""
    query, inputs = tensors.read(body, None, most_json=1000)
    assert np.array_equal(inputs["states"], [[1, 2]])
    assert (query.id, query.inputs) == ("mine", [])
    assert query.parameters == {"binary_data_output": True}
    assert [output.parameters for output in query.outputs] == [{"binary_data": True}]
