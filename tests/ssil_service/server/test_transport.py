"""Writes of one round of the event loop are sent together; long ones at once."""

import asyncio
from collections.abc import Callable
from typing import Any

from ssil_service.server.transport import CoalescingTransport


class Wire:
    """A transport that remembers its calls."""

    def __init__(self) -> None:
        self.calls: list[Any] = []
        self.get_extra_info = self.is_closing = lambda *_: None
        self.pause_reading = self.resume_reading = lambda: None

    def write(self, data: bytes) -> None:
        self.calls.append(data)

    def close(self) -> None:
        self.calls.append("closed")

    def abort(self) -> None:
        self.calls.append("aborted")

    def get_write_buffer_size(self) -> int:
        return 100


def run(work: Callable[[CoalescingTransport, Wire], None]) -> list[Any]:
    """Return what is called on the wire during some work and the loop's next round."""
    wire = Wire()

    async def rounds() -> None:
        work(CoalescingTransport(wire, asyncio.get_running_loop()), wire)  # pyright: ignore[reportArgumentType]
        await asyncio.sleep(0)

    asyncio.run(rounds())
    return wire.calls


def test_head_and_body_are_sent_together_in_the_next_round():
    def answer(transport: CoalescingTransport, wire: Wire) -> None:
        for part in (b"head", b"body", b""):
            transport.write(part)
        assert wire.calls == []
        assert transport.get_write_buffer_size() == 108

    assert run(answer) == [b"headbody"]


def test_every_round_sends_what_it_wrote():
    wire = Wire()

    async def rounds() -> None:
        transport = CoalescingTransport(wire, asyncio.get_running_loop())  # pyright: ignore[reportArgumentType]
        for part in (b"head", b"event", b"event"):
            transport.write(part)
            await asyncio.sleep(0)

    asyncio.run(rounds())
    assert wire.calls == [b"head", b"event", b"event"]


def test_a_long_body_is_sent_at_once():
    def answer(transport: CoalescingTransport, wire: Wire) -> None:
        transport.write(b"head")
        transport.write(bytes(65_536))
        assert wire.calls == [b"head" + bytes(65_536)]
        assert transport.get_write_buffer_size() == 100

    assert len(run(answer)) == 1


def test_what_was_written_is_sent_before_the_connection_is_closed():
    def answer(transport: CoalescingTransport, wire: Wire) -> None:
        transport.write(b"last words")
        transport.close()

    assert run(answer) == [b"last words", "closed"]


def test_an_aborted_connection_sends_nothing_more():
    def answer(transport: CoalescingTransport, wire: Wire) -> None:
        transport.write(b"last words")
        transport.abort()

    assert run(answer) == ["aborted"]
