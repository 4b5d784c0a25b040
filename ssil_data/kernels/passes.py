"""Passes of compiled code over packed references, and how they are cut up for several threads.

The bits of a query's answer do not depend on the cut: neither on the other queries of the call nor
on the number of threads. Sums over a block of references are always added up in the same order.
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
"""Distance from the center, times 1 + 1/α, from which 2 max(a, b) − a − b cancels too much."""
_TILES_PER_PASS = 32
"""Tiles of queries in a pass; while they share a block, it stays in the cache."""
_MAX_BRACKETS = 1 << 23
"""Brackets, one for each query and panel, that all threads together keep in memory."""
_MIN_PAIRS_FOR_THREADS = 1 << 22
"""Pairs of a query and a reference below which starting threads takes longer than it saves."""


@dataclass(frozen=True)
class Pass:
    """One run of compiled code: the code, the α to run it at, and the references to run it over.

    `threads` share the references.
    """

    code: Code
    alpha: float
    panels: Panels
    threads: int

    def __call__(
        self, queries: NDArray[np.float32], distance: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Return the code's sums (products, m), and each panel's smallest brackets (m, panels).

        Weights are the kernel relative to that at `distance` d₀ (m,) of each of the centered
        queries (m, d); u is (d − d₀) / (α + d₀). A bracket stands for a distance, see `distance`.
        """
        tile = self.code.tile
        packed = self._pack(queries, distance)
        values = self.panels.values
        blocks = -(-len(values) // tile.panels)
        sums = np.empty((blocks, len(packed), self.code.products.count, tile.queries))
        brackets = np.empty((len(packed) * tile.queries, len(values)), np.float32)
        exponent = (self.alpha + 1) / 2

        def run(part: tuple[int, int]) -> None:
            self.code(values, packed, sums, brackets, blocks=part, exponent=exponent)

        shards = min(2 * self.threads, blocks) if self.threads > 1 else 1
        _map_jobs(run, pairwise(i * blocks // shards for i in range(shards + 1)), self.threads)
        whole = sums.sum(axis=0).transpose(1, 0, 2).reshape(self.code.products.count, -1)
        return whole[:, : len(queries)], brackets[: len(queries)]

    def _pack(
        self, queries: NDArray[np.float32], distance: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        """Return tiles (·, d + 2, queries of a tile): dimensions, and factor and offset of t or u.

        t = factor · bracket + offset. The last tile is filled up with the last query.
        """
        factor = (1 if self.code.direct else 2) / (self.alpha + distance)
        offset = (self.distance(queries, 0) - distance) / (self.alpha + distance)
        columns = [queries, factor[:, None], offset[:, None] + self.code.power.offset]
        rows = np.concatenate(columns, axis=1, dtype=np.float32)
        size = self.code.tile.queries
        tiles = -(-len(rows) // size)
        filled = rows[np.minimum(np.arange(tiles * size), len(rows) - 1)]
        return np.ascontiguousarray(filled.reshape(tiles, size, -1).transpose(0, 2, 1))

    def distance(
        self, queries: NDArray[np.float32], bracket: NDArray[np.float32] | float
    ) -> NDArray[np.float64]:
        """Return the distances that brackets stand for; rounding may leave them below 0.

        Parameters
        ----------
        queries
            Centered queries (m, d).
        bracket
            Brackets (m,), one of each query; or one for all.
        """
        if self.code.direct:
            return np.zeros(len(queries)) + bracket
        return 2.0 * np.asarray(bracket, np.float64) - queries.astype(np.float64).sum(axis=1)


class Joinable(Protocol):
    """Answers to queries, of which some can be taken and several joined."""

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return the answers to some of the queries.

        Parameters
        ----------
        rows
            Indices of queries, in the order wanted.
        """
        ...

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return the answers of all parts, one after the other.

        Parameters
        ----------
        parts
            Answers to different queries.
        """
        ...


Answer = TypeVar("Answer", bound=Joinable)
Job = TypeVar("Job")
Result = TypeVar("Result")


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
    """Cut queries into parts, answer each in a thread, and join the answers.

    Where there are too few queries for that, the threads share the references.

    Parameters
    ----------
    answer
        Gets the pass to run and the rows of a part of the queries; returns their answers.
    queries
        Centered queries (m, d), m ≥ 1.
    panels
        The references.
    products
        What to add up.
    target
        Processor to write code for.
    alpha
        Sharpness of the kernel, > 0.
    threads
        Threads to share the work; by default all processors that this process may use, where there
        is work for them.
    """
    threads = threads or (
        _count_processors() if len(queries) * panels.count >= _MIN_PAIRS_FOR_THREADS else 1
    )
    if len(queries) == 1:
        target = target.for_one_query()
    brackets_per_tile = target.tile.queries * len(panels.values)
    tiles = min(_TILES_PER_PASS, max(1, _MAX_BRACKETS // (threads * brackets_per_tile)))
    # far queries take the distances that are added up directly, see `inner_loop`
    far = np.abs(queries).sum(axis=1) * (1 + 1 / alpha) > _MAX_RELATIVE_DISTANCE
    rows = {direct: np.flatnonzero(far == direct) for direct in (False, True)}
    cuts = {
        direct: _cut(chosen, tiles * target.tile.queries, threads)
        for direct, chosen in rows.items()
        if len(chosen)
    }
    few = all(len(cut) == 1 for cut in cuts.values())
    parts = []
    for direct, cut in cuts.items():
        code = compile_code(target, Power.of(alpha), products, direct=direct)
        work = Pass(code, alpha, panels, threads if few else 1)
        parts += [(work, chosen) for chosen in cut]
    whole = _map_jobs(lambda part: answer(*part), parts, 1 if few else threads)
    order = np.concatenate([rows for _, rows in parts])
    return type(whole[0]).join(whole).take(np.argsort(order))


def _map_jobs(work: Callable[[Job], Result], jobs: Iterable[Job], threads: int) -> list[Result]:
    """Return the results of all jobs, in order."""
    if threads == 1:
        return list(map(work, jobs))
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, jobs))


def _cut(rows: NDArray[np.int64], most: int, threads: int) -> list[NDArray[np.int64]]:
    """Cut into equal parts of at most `most`; where there are several, as many for each thread."""
    count = -(-len(rows) // most)
    return np.array_split(rows, -(-count // threads) * threads if count > 1 else 1)


def _count_processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
