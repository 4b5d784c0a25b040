"""What leaves a connection together, and what never waits."""

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


def written(work: Callable[[CoalescingTransport, Wire], None]) -> list[Any]:
    """Return the calls that came of some work, and of the loop's next round."""
    wire = Wire()

    async def rounds() -> None:
        work(CoalescingTransport(wire, asyncio.get_running_loop()), wire)  # pyright: ignore[reportArgumentType]
        await asyncio.sleep(0)

    asyncio.run(rounds())
    return wire.calls


def test_head_and_body_leave_together_in_the_next_round():
    def answer(gathered: CoalescingTransport, wire: Wire) -> None:
        for part in (b"head", b"body", b""):
            gathered.write(part)
        assert wire.calls == []
        assert gathered.get_write_buffer_size() == 108

    assert written(answer) == [b"headbody"]


def test_every_round_sends_what_it_wrote():
    wire = Wire()

    async def rounds() -> None:
        gathered = CoalescingTransport(wire, asyncio.get_running_loop())  # pyright: ignore[reportArgumentType]
        for part in (b"head", b"event", b"event"):
            gathered.write(part)
            await asyncio.sleep(0)

    asyncio.run(rounds())
    assert wire.calls == [b"head", b"event", b"event"]


def test_a_long_body_waits_for_nothing():
    def answer(gathered: CoalescingTransport, wire: Wire) -> None:
        gathered.write(b"head")
        gathered.write(bytes(65_536))
        assert wire.calls == [b"head" + bytes(65_536)]
        assert gathered.get_write_buffer_size() == 100

    assert len(written(answer)) == 1


def test_what_was_written_is_sent_before_the_connection_is_closed():
    def answer(gathered: CoalescingTransport, wire: Wire) -> None:
        gathered.write(b"last words")
        gathered.close()

    assert written(answer) == [b"last words", "closed"]


def test_a_connection_that_is_cut_sends_nothing_more():
    def answer(gathered: CoalescingTransport, wire: Wire) -> None:
        gathered.write(b"last words")
        gathered.abort()

    assert written(answer) == ["aborted"]
