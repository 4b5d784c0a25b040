"""One request and its answer: chunks, the least pace of a client, and added headers."""

import asyncio
from typing import Any

import pytest

from ssil_service.http import limits
from ssil_service.http.limits import RequestLimits, SlowClientError
from ssil_service.http.memory_budget import MemoryBudget
from ssil_service.settings import Settings

SCOPE = {"type": "http", "method": "GET", "path": "/", "headers": [(b"x-request-id", b"mine")]}


def sent(size: int, *, seconds: float, method: str = "GET", **settings: Any) -> list[Any]:
    """Send an answer of `size` bytes to a client that takes `seconds` for each message."""
    messages: list[Any] = []

    async def send(message: Any) -> None:
        await asyncio.sleep(seconds)
        messages.append(message)

    async def receive() -> Any:
        raise AssertionError("nothing is received")

    async def answer() -> None:
        budget = MemoryBudget(10**9)
        scope = {**SCOPE, "method": method}
        here = RequestLimits(scope, receive, send, settings=Settings(**settings), budget=budget)
        length = (b"content-length", str(size).encode())
        await here.send({"type": "http.response.start", "status": 200, "headers": [length]})
        assert budget.bytes == size
        await here.send({"type": "http.response.body", "body": bytes(range(256)) * (size // 256)})
        here.close()
        assert budget.bytes == 0

    asyncio.run(answer())
    return messages


def test_a_long_body_is_sent_in_parts():
    head, *parts = sent(10 * 65_536, seconds=0)
    assert dict(head["headers"])[b"x-request-id"] == b"mine"
    assert dict(head["headers"])[b"cache-control"] == b"no-cache"
    assert [part["more_body"] for part in parts] == [True] * 9 + [False]
    assert b"".join(bytes(part["body"]) for part in parts) == bytes(range(256)) * 2560


def test_a_head_is_sent_without_its_body():
    _, *parts = sent(65_536 * 3, seconds=0, method="HEAD")
    assert [bytes(part["body"]) for part in parts] == [b""]


def test_a_client_may_be_slow_but_not_slower_than_the_slowest(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        limits, "SLOWEST_BYTES_PER_SECOND", 65_536 * 50
    )  # a part in twenty milliseconds
    assert len(sent(20 * 65_536, seconds=0.01, send_seconds=0.2)) == 21
    with pytest.raises(SlowClientError):
        sent(20 * 65_536, seconds=0.06, send_seconds=0.2)
