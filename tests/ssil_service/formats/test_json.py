"""JSON that is long: one place reads and writes it, as nothing else runs meanwhile."""

import asyncio
import gc
import time
from collections.abc import Iterator
from threading import Lock
from typing import Any

import httpx
import numpy as np
import pytest

from ssil_data.client.wire import ARROW, JSON
from ssil_service import embed
from ssil_service.formats import inference_tensors as tensors
from ssil_service.problems import Problem
from ssil_service.queries.admission import BoundedExecutor
from ssil_service.routes import bodies as intake
from ssil_service.routes.bodies import run_off_loop
from ssil_service.routes.pages import most_rows

LCOR = "v1/datasets/drives/runs/vae/lcor"
INFER = "v2/models/drives.vae.lcor/infer"


def test_long_json_is_read_and_written_one_at_a_time():
    busy, most, guard = 0, 0, Lock()

    def work() -> None:
        nonlocal busy, most
        with guard:
            busy += 1
            most = max(most, busy)
        time.sleep(0.01)
        with guard:
            busy -= 1

    async def crowd() -> list[Any]:
        place = BoundedExecutor(1, 3)
        asked = [run_off_loop(2**20, work, place) for _ in range(6)]
        found = await asyncio.gather(*asked, return_exceptions=True)
        place.close(1)
        return found

    found = asyncio.run(crowd())
    assert most == 1
    assert [type(each) for each in found] == [type(None)] * 4 + [Problem] * 2


def test_nothing_is_collected_while_long_json_is_read():
    async def ask(work: Any) -> Any:
        place = BoundedExecutor(1, 0)
        try:
            return await run_off_loop(2**20, work, place)
        finally:
            place.close(1)

    assert asyncio.run(ask(gc.isenabled)) is False
    assert gc.isenabled()
    with pytest.raises(ZeroDivisionError):
        asyncio.run(ask(lambda: 1 / 0))
    assert gc.isenabled()


@pytest.fixture
def crowded(scored: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[httpx.Client]:
    """Start a service whose place for long JSON is taken, and to which everything is long."""
    monkeypatch.setattr(intake, "_INLINE", 0)
    with embed(scored, jobs=1) as store:
        http = store.connection.client
        transport: Any = http._transport
        transport.app.context().json_executor.admitted = 100
        yield http


def test_long_json_is_refused_where_too_much_waits(crowded: httpx.Client):
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
    asked, inputs = tensors.read(body, None, most_json=1000)
    assert np.array_equal(inputs["states"], [[1, 2]])
    assert (asked.id, asked.inputs) == ("mine", [])
    assert asked.parameters == {"binary_data_output": True}
    assert [output.parameters for output in asked.outputs] == [{"binary_data": True}]
