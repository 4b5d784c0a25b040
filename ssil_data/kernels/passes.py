"""Passes of compiled code over packed references, cut into pieces for several threads."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import reduce
from itertools import islice, product, starmap
from operator import add
from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.native import Code, Target, compiled
from ssil_data.kernels.panels import Panels
from ssil_data.kernels.power import Power
from ssil_data.kernels.products import Products

_CANCELLATION = 200.0
"""Distance from the centre, times 1 + 1/α, from which 2 max(a, b) − a − b is too coarse."""
_TILES, _BRACKETS = 32, 1 << 23
"""Tiles of queries that pass the references together, and numbers that all threads may hold."""
_INLINE = 1 << 22
"""Pairs below which threads are not worth their start."""


@dataclass(frozen=True)
class Pass:
    """Compiled code with the α that it is to be run at."""

    code: Code
    alpha: float

    def __call__(
        self, queries: NDArray[np.float32], distance: NDArray[np.float64], panels: Panels
    ) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Return the code's products (count, m), and the smallest bracket in each panel (m, ·).

        Weights are the kernel relative to that at `distance` d₀ (m,); u is (d − d₀) / (α + d₀).
        """
        factor = (1 if self.code.direct else 2) / (self.alpha + distance)
        offset = (self.distance(queries, 0) - distance) / (self.alpha + distance)
        columns = [queries, factor[:, None], offset[:, None] + self.code.power.offset]
        rows, per_tile = np.concatenate(columns, axis=1, dtype=np.float32), self.code.tile.queries
        tiles, count = -(-len(rows) // per_tile), self.code.products.count
        filled = rows[np.minimum(np.arange(tiles * per_tile), len(rows) - 1)]
        packed = np.ascontiguousarray(filled.reshape(tiles, per_tile, -1).transpose(0, 2, 1))
        sums = np.zeros((tiles, count, per_tile))
        brackets = np.empty((tiles * per_tile, len(panels.values)), np.float32)
        self.code(panels.values, packed, sums, brackets, exponent=(self.alpha + 1) / 2)
        return sums.transpose(1, 0, 2).reshape(count, -1)[:, : len(rows)], brackets[: len(rows)]

    def distance(
        self, queries: NDArray[np.float32], bracket: NDArray[np.float32] | float
    ) -> NDArray[np.float64]:
        """Return the distances that brackets (m,) stand for; rounding may leave them below 0."""
        if self.code.direct:
            return np.zeros(len(queries)) + bracket
        return 2.0 * np.asarray(bracket, np.float64) - queries.sum(axis=1, dtype=np.float64)


class Additive(Protocol):
    """Answers to some queries, which add up over shards of the references."""

    def __add__(self, other: Self, /) -> Self:
        """Join the answers of two shards."""
        ...

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return the answers to the queries `rows`, in their order."""
        ...

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Return the answers of some parts, one after the other."""
        ...


Answer = TypeVar("Answer", bound=Additive)


def spread(
    answer: Callable[[Pass, NDArray[np.int64], Panels], Answer],
    queries: NDArray[np.float32],
    panels: Panels,
    products: Products,
    *,
    target: Target,
    alpha: float,
    threads: int | None,
    shard: bool = True,
) -> Answer:
    """Cut centred queries (m, d), m ≥ 1, into parts and panels into shards; join the answers.

    `answer` gets the pass to make, the rows of the part and a shard. `threads` defaults to all
    processors that this process may use, where there is work for them.
    """
    threads = threads or (_processors() if len(queries) * panels.count >= _INLINE else 1)
    if len(queries) == 1:
        target = target.for_one_query()
    brackets_per_tile = target.tile.queries * len(panels.values)
    tiles = min(_TILES, max(1, _BRACKETS // (threads * brackets_per_tile)))
    far = np.abs(queries).sum(axis=1) * (1 + 1 / alpha) > _CANCELLATION
    parts = []
    for direct in (False, True):
        rows = np.flatnonzero(far == direct)
        if len(rows):
            work = Pass(compiled(target, Power.of(alpha), products, direct=direct), alpha)
            cut = _parts(rows, tiles * target.tile.queries, threads)
            parts += [(work, chosen) for chosen in cut]
    shards = panels.shards(-(-2 * threads // len(parts)) if shard and threads > 1 else 1)
    jobs = [(work, rows, panels) for (work, rows), panels in product(parts, shards)]
    done = iter(_each(answer, jobs, threads))
    whole = [reduce(add, islice(done, len(shards))) for _ in parts]
    order = np.concatenate([rows for _, rows in parts])
    return type(whole[0]).joined(whole).take(np.argsort(order))


def _each(
    answer: Callable[[Pass, NDArray[np.int64], Panels], Answer],
    jobs: list[tuple[Pass, NDArray[np.int64], Panels]],
    threads: int,
) -> list[Answer]:
    if threads == 1 or len(jobs) == 1:
        return list(starmap(answer, jobs))
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(answer, *zip(*jobs, strict=True)))


def _parts(rows: NDArray[np.int64], most: int, threads: int) -> list[NDArray[np.int64]]:
    """Cut into equal parts of at most `most`; where there are several, as many for each thread."""
    count = -(-len(rows) // most)
    return np.array_split(rows, -(-count // threads) * threads if count > 1 else 1)


def _processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
