"""Small questions to one field that are asked in one round of the loop are answered together.

A question alone reads all demonstrations for itself; many together read them once. The bits of
code written for the processor do not depend on what is asked with a state; torch's may.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ssil_data.field import LeverageField
from ssil_data.field.answers import Contributors, LCoR
from ssil_data.kernels.references import HOST, MIN_COMPILED_ALPHA


@dataclass(eq=False)
class _Batch:
    """Questions that are not asked yet, and who waits for them."""

    asked: LeverageField
    rows: int = 0
    states: list[NDArray[np.float32]] = field(default_factory=list)
    waiting: list[asyncio.Future[LCoR]] = field(default_factory=list)


class Batching:
    """Exact LCoR of small questions; of one loop.

    `most` is the number of pairs of a query and a demonstration state that are computed without
    leaving the loop to others.
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self._open: dict[int, _Batch] = {}

    async def lcor(self, asked: LeverageField, states: NDArray[np.float32]) -> LCoR:
        """Return LCoR of states (m, d) in raw units, of the field's width and finite.

        What the engine raises, it raises for all that are asked together.
        """
        if HOST is None or asked.alpha < MIN_COMPILED_ALPHA:
            return asked.lcor(states)
        loop = asyncio.get_running_loop()
        batch = self._open.get(id(asked))
        if batch is None or (batch.rows + len(states)) * len(asked.states) > self.most:
            batch = self._open[id(asked)] = _Batch(asked)
            loop.call_soon(self._ask, batch)
        batch.rows += len(states)
        batch.states.append(states)
        batch.waiting.append(loop.create_future())
        return await batch.waiting[-1]

    def _ask(self, batch: _Batch) -> None:
        if self._open.get(id(batch.asked)) is batch:
            del self._open[id(batch.asked)]
        some = [
            (states, future)
            for states, future in zip(batch.states, batch.waiting, strict=True)
            if not future.done()  # nobody computes for those who have gone
        ]
        if not some:
            return
        try:
            answer = batch.asked.lcor(np.concatenate([states for states, _ in some]))
        except Exception as error:
            for _, future in some:
                future.set_exception(error)
            return
        first = 0
        for states, future in some:
            future.set_result(_part(answer, slice(first, first + len(states))))
            first += len(states)


def _part(answer: LCoR, rows: slice) -> LCoR:
    """Return the answers to some states."""
    of_rows = Contributors(answer.contributors.row[rows], answer.contributors.share[rows])
    names = ("values", "effective_sample_size", "half_width")
    return LCoR(*(getattr(answer, name)[rows] for name in names), contributors=of_rows)
