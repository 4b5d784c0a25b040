"""The engine behind LCoR: reference states, packed once, and exact sums over all of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import reduce
from itertools import islice, product, starmap
from operator import add

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels import chunked
from ssil_data.kernels.exact import ExactSums
from ssil_data.kernels.native import GENERIC, Target, compiled
from ssil_data.kernels.panels import Panels
from ssil_data.kernels.power import Power
from ssil_data.kernels.sums import Sums

_HOST = Target.host()
_FLATTEST, _SHARPEST = 1e-3, 1e12
"""Below the first α, float32 does not hold t. From the second on, the kernel is exp(−d/2)."""
_CANCELLATION = 200.0
"""Distance from the centre, times 1 + 1/α, from which 2 max(a, b) − a − b is too coarse."""
_TILES, _BRACKETS = 32, 1 << 23
"""Tiles of queries that pass the references together, and numbers that all threads may hold."""
_INLINE = 1 << 22
"""Pairs below which threads are not worth their start."""


class References:
    """States (n, d), n ≥ 1, with their leverage (n,), centred and packed for one processor.

    `target` is the processor to write code for; None, as on unknown hosts, is plain torch.
    """

    def __init__(
        self,
        states: NDArray[np.float32],
        leverage: NDArray[np.float32],
        *,
        target: Target | None = _HOST,
    ) -> None:
        self.target = target
        self._centre = _centre(states)
        self._mean = float(leverage.mean(dtype=np.float64))
        size = (target or GENERIC).tile.references
        self._panels = Panels.of(states, self._centre, leverage - self._mean, size)

    def sums(
        self,
        queries: NDArray[np.float32],
        *,
        alpha: float,
        contributors: int = 0,
        threads: int | None = None,
    ) -> Sums:
        """Return the sums of equation 5 for queries (m, d) in the references' units.

        `contributors` > 0 also names that many of the heaviest references; `threads` defaults to
        all processors that this process may use, where there is work for them.
        """
        centred = queries - self._centre
        if self.target is None or alpha < _FLATTEST or not len(queries):
            sums = chunked.lcor_sums(
                centred, *self._panels.unpacked(), alpha=alpha, contributors=contributors
            )
        else:
            worth_it = len(queries) * self._panels.count >= _INLINE
            count = threads or (_processors() if worth_it else 1)
            sums = self._compiled(centred, self.target, min(alpha, _SHARPEST), contributors, count)
        return replace(sums, numerator=sums.numerator + self._mean * sums.denominator)

    def _compiled(
        self,
        queries: NDArray[np.float32],
        target: Target,
        alpha: float,
        contributors: int,
        threads: int,
    ) -> Sums:
        """Cut the queries into chunks, the references into shards, and join the sums of each."""
        if len(queries) == 1:
            target = target.for_one_query()
        brackets_per_tile = target.tile.queries * len(self._panels.values)
        tiles = min(_TILES, max(1, _BRACKETS // (threads * brackets_per_tile)))
        far = np.abs(queries).sum(axis=1) * (1 + 1 / alpha) > _CANCELLATION
        chunks = []
        for direct in (False, True):
            rows = np.flatnonzero(far == direct)
            if len(rows):
                code = compiled(target, Power.of(alpha), direct=direct)
                work = ExactSums(code, alpha, contributors)
                parts = _parts(rows, tiles * target.tile.queries, threads)
                chunks += [(work, part) for part in parts]
        # shards smaller than `contributors` could not name enough of them
        alone = threads == 1 or contributors > self._panels.size
        shards = self._panels.shards(1 if alone else -(-2 * threads // len(chunks)))

        def task(chunk: tuple[ExactSums, NDArray[np.int64]], shard: Panels) -> Sums:
            work, rows = chunk
            return work(queries[rows], shard)

        done = iter(_each(task, list(product(chunks, shards)), threads))
        whole = [reduce(add, islice(done, len(shards))) for _ in chunks]
        order = np.concatenate([rows for _, rows in chunks])
        return Sums.joined(whole).take(np.argsort(order))


def lcor_sums(
    queries: NDArray[np.float32],
    states: NDArray[np.float32],
    leverage: NDArray[np.float32],
    *,
    alpha: float,
    contributors: int = 0,
) -> Sums:
    """Return the sums of equation 5 for queries (m, d) over states (n, d), n ≥ 1, packed for once.

    States and queries are standardised already; leverage is (n,).
    """
    return References(states, leverage).sums(queries, alpha=alpha, contributors=contributors)


def _each(task: Callable[..., Sums], arguments: list[tuple], threads: int) -> list[Sums]:
    if threads == 1 or len(arguments) == 1:
        return list(starmap(task, arguments))
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(task, *zip(*arguments, strict=True)))


def _parts(rows: NDArray[np.int64], most: int, threads: int) -> list[NDArray[np.int64]]:
    """Cut into equal parts of at most `most`; where there are several, as many for each thread."""
    count = -(-len(rows) // most)
    return np.array_split(rows, -(-count // threads) * threads if count > 1 else 1)


def _centre(states: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return about the mean (d,), so round that subtracting it loses no bits.

    It is a whole multiple of a power of two near the deviation, which a sample tells.
    """
    deviation = states[:: 1 + len(states) // 4096].std(axis=0, dtype=np.float64)
    grain = np.exp2(np.floor(np.log2(np.maximum(deviation, 2.0**-60))))
    mean = states.mean(axis=0, dtype=np.float64)
    return (np.rint(mean / grain) * grain).astype(np.float32)


def _processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
