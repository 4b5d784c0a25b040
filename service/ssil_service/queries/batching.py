"""Small LCoR queries to one field that arrive in one round of the event loop are computed together.

A query alone reads all demonstrations for itself; many together read them once. With the kernel
compiled for this processor, an answer's bits do not depend on the other queries of its batch; with
torch's kernels they may, so there queries are computed one by one.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from dataclasses import field as dataclass_field

import numpy as np
from numpy.typing import NDArray

from ssil_data.field import LeverageField
from ssil_data.field.answers import Contributors, LCoR
from ssil_data.kernels.references import HOST, MIN_COMPILED_ALPHA


@dataclass(eq=False)
class _Batch:
    """Queries that are not computed yet, and the futures of their answers."""

    field: LeverageField
    rows: int = 0
    states: list[NDArray[np.float32]] = dataclass_field(default_factory=list)
    futures: list[asyncio.Future[LCoR]] = dataclass_field(default_factory=list)


class Batching:
    """Exact LCoR of small queries, for one event loop.

    Parameters
    ----------
    most
        Pairs of a query and a demonstration state that are computed at one go, during which the
        loop does nothing else.
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self._open: dict[int, _Batch] = {}

    async def lcor(self, field: LeverageField, states: NDArray[np.float32]) -> LCoR:
        """Compute LCoR together with other queries of this round of the loop.

        Parameters
        ----------
        field
            The field to query.
        states
            (m, d) in raw units, of the field's width and finite.

        Returns
        -------
        LCoR
            With the bits of `field.lcor(states)`.

        Raises
        ------
        Exception
            What the computation raises, it raises for all queries of the batch.
        """
        if HOST is None or field.alpha < MIN_COMPILED_ALPHA:
            return field.lcor(states)
        loop = asyncio.get_running_loop()
        batch = self._open.get(id(field))
        if batch is None or (batch.rows + len(states)) * len(field.states) > self.most:
            batch = _Batch(field)
            self._open[id(field)] = batch
            loop.call_soon(self._compute, batch)
        batch.rows += len(states)
        batch.states.append(states)
        batch.futures.append(loop.create_future())
        return await batch.futures[-1]

    def _compute(self, batch: _Batch) -> None:
        """Compute a batch, without the queries whose clients have disconnected."""
        if self._open.get(id(batch.field)) is batch:
            del self._open[id(batch.field)]
        queries = [
            (states, future)
            for states, future in zip(batch.states, batch.futures, strict=True)
            if not future.done()
        ]
        if not queries:
            return
        try:
            answer = batch.field.lcor(np.concatenate([states for states, _ in queries]))
        except Exception as error:
            for _, future in queries:
                future.set_exception(error)
            return
        first = 0
        for states, future in queries:
            future.set_result(_take_rows(answer, slice(first, first + len(states))))
            first += len(states)


def _take_rows(answer: LCoR, rows: slice) -> LCoR:
    contributors = Contributors(answer.contributors.row[rows], answer.contributors.share[rows])
    return LCoR(
        answer.values[rows],
        answer.effective_sample_size[rows],
        answer.half_width[rows],
        contributors=contributors,
    )
