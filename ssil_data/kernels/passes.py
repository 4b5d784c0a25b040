"""Passes of compiled code over packed references, cut into pieces for several threads.

A query's answer does not depend on the cut, to the last bit: not on the other queries of the call,
nor on the number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.native import Code, Target, compile_code
from ssil_data.kernels.panels import Panels
from ssil_data.kernels.power import Power
from ssil_data.kernels.products import Products

_MAX_RELATIVE_DISTANCE = 200.0
"""Distance from the center, times 1 + 1/α, from which 2 max(a, b) − a − b is too coarse."""
_TILES_PER_PASS, _MAX_BRACKETS = 32, 1 << 23
"""Tiles of queries that pass the references together, and brackets that all threads may hold."""
_MIN_PAIRS_FOR_THREADS = 1 << 22
"""Pairs below which threads are not worth their start."""


@dataclass(frozen=True)
class Pass:
    """Compiled code, the α that it is to be run at, and the references, for `threads` to share."""

    code: Code
    alpha: float
    panels: Panels
    threads: int

    def __call__(
        self, queries: NDArray[np.float32], distance: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Return the code's products (count, m), and the smallest bracket in each panel (m, ·).

        Weights are the kernel relative to that at `distance` d₀ (m,); u is (d − d₀) / (α + d₀).
        """
        factor = (1 if self.code.direct else 2) / (self.alpha + distance)
        offset = (self.distance(queries, 0) - distance) / (self.alpha + distance)
        columns = [queries, factor[:, None], offset[:, None] + self.code.power.offset]
        rows, tile = np.concatenate(columns, axis=1, dtype=np.float32), self.code.tile
        tiles, count = -(-len(rows) // tile.queries), self.code.products.count
        filled = rows[np.minimum(np.arange(tiles * tile.queries), len(rows) - 1)]
        packed = np.ascontiguousarray(filled.reshape(tiles, tile.queries, -1).transpose(0, 2, 1))
        values = self.panels.values
        blocks = -(-len(values) // tile.panels)
        sums = np.empty((blocks, tiles, count, tile.queries))
        brackets = np.empty((tiles * tile.queries, len(values)), np.float32)

        def run(part: tuple[int, int]) -> None:
            exponent = (self.alpha + 1) / 2
            self.code(values, packed, sums, brackets, blocks=part, exponent=exponent)

        shards = min(2 * self.threads, blocks) if self.threads > 1 else 1
        _each(run, pairwise(i * blocks // shards for i in range(shards + 1)), self.threads)
        whole = sums.sum(axis=0).transpose(1, 0, 2).reshape(count, -1)
        return whole[:, : len(rows)], brackets[: len(rows)]

    def distance(
        self, queries: NDArray[np.float32], bracket: NDArray[np.float32] | float
    ) -> NDArray[np.float64]:
        """Return the distances that brackets (m,) stand for; rounding may leave them below 0."""
        if self.code.direct:
            return np.zeros(len(queries)) + bracket
        return 2.0 * np.asarray(bracket, np.float64) - queries.astype(np.float64).sum(axis=1)


class Joinable(Protocol):
    """Answers to some queries."""

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return the answers to the queries `rows`, in their order."""
        ...

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return the answers of some parts, one after the other."""
        ...


Answer = TypeVar("Answer", bound=Joinable)
Asked = TypeVar("Asked")
Found = TypeVar("Found")


def run_parallel(
    answer: Callable[[Pass, NDArray[np.int64]], Answer],
    queries: NDArray[np.float32],
    panels: Panels,
    products: Products,
    *,
    target: Target,
    alpha: float,
    threads: int | None,
) -> Answer:
    """Cut centered queries (m, d), m ≥ 1, into parts, a thread for each; join the answers.

    Where there are too few queries for that, threads share the references. `answer` gets the pass
    to make and the rows of a part. `threads` defaults to all processors that this process may use,
    where there is work for them.
    """
    threads = threads or (
        _count_processors() if len(queries) * panels.count >= _MIN_PAIRS_FOR_THREADS else 1
    )
    if len(queries) == 1:
        target = target.for_one_query()
    brackets_per_tile = target.tile.queries * len(panels.values)
    tiles = min(_TILES_PER_PASS, max(1, _MAX_BRACKETS // (threads * brackets_per_tile)))
    far = np.abs(queries).sum(axis=1) * (1 + 1 / alpha) > _MAX_RELATIVE_DISTANCE
    rows = {direct: np.flatnonzero(far == direct) for direct in (False, True)}
    cuts = {
        direct: _parts(asked, tiles * target.tile.queries, threads)
        for direct, asked in rows.items()
        if len(asked)
    }
    few = all(len(cut) == 1 for cut in cuts.values())
    parts = []
    for direct, cut in cuts.items():
        code = compile_code(target, Power.of(alpha), products, direct=direct)
        work = Pass(code, alpha, panels, threads if few else 1)
        parts += [(work, chosen) for chosen in cut]
    whole = _each(lambda part: answer(*part), parts, 1 if few else threads)
    order = np.concatenate([rows for _, rows in parts])
    return type(whole[0]).join(whole).take(np.argsort(order))


def _each(work: Callable[[Asked], Found], jobs: Iterable[Asked], threads: int) -> list[Found]:
    if threads == 1:
        return list(map(work, jobs))
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, jobs))


def _parts(rows: NDArray[np.int64], most: int, threads: int) -> list[NDArray[np.int64]]:
    """Cut into equal parts of at most `most`; where there are several, as many for each thread."""
    count = -(-len(rows) // most)
    return np.array_split(rows, -(-count // threads) * threads if count > 1 else 1)


def _count_processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
