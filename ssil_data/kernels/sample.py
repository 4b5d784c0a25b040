"""A random sample of the references, packed as it grows, and its moments about queries."""

from __future__ import annotations

from functools import reduce
from operator import add
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.moments import SampleMoments
from ssil_data.kernels.native import GENERIC, Target
from ssil_data.kernels.panels import Panels
from ssil_data.kernels.passes import Pass, run_parallel
from ssil_data.kernels.products import Products
from ssil_data.kernels.rows import Rows

FIRST_PART = 8192
"""References in the first part of a sample; every other part doubles it."""


class Sample:
    """The beginning of a random order of the references; it is read as far as it is needed.

    It grows in parts, which stay in memory, packed. Several threads may share it.

    Parameters
    ----------
    states
        References (n, d).
    leverage
        Leverages (n,).
    center
        Subtracted from the states, (d,).
    mean
        Subtracted from the leverages.
    seed
        Of the random order.
    target
        Processor to write code for; None for plain torch.
    """

    def __init__(
        self,
        states: Rows,
        leverage: NDArray[np.float32],
        center: NDArray[np.float32],
        mean: float,
        *,
        seed: int,
        target: Target | None,
    ) -> None:
        self._states = states
        self._leverage = leverage
        self._center = center
        self._mean = mean
        self._seed = seed
        self._target = target
        self._size = (target or GENERIC).tile.references
        self._order: NDArray[np.integer] | None = None
        self._parts: list[Panels] = []
        self._growing = Lock()

    @property
    def max_size(self) -> int:
        """A quarter of the references, in whole panels: beyond it, exact sums are faster."""
        return self._states.shape[0] // 4 // self._size * self._size

    def round_up(self, size: float) -> int:
        """Return the smallest size that a sample can have, in whole panels, but at most `max_size`.

        Parameters
        ----------
        size
            References wanted.
        """
        return min(int(-(-size // self._size)) * self._size, self.max_size)

    def moments(
        self,
        queries: NDArray[np.float32],
        distance: NDArray[np.float64],
        begin: int,
        end: int,
        *,
        alpha: float,
        threads: int | None,
    ) -> SampleMoments:
        """Return the moments of some references of the sample about queries.

        Parameters
        ----------
        queries
            Centered queries (m, d).
        distance
            Mean distance d₀ of each query to all references, (m,); weights are relative to it.
        begin, end
            First reference of the sample's order, and the one after the last; sizes that `round_up`
            gave.
        alpha
            Sharpness of the kernel, > 0.
        threads
            Threads to share the work; None for all processors.
        """
        found = []
        for first, panels in self._grow_to(end):
            low, high = (min(max(place - first, 0), panels.count) for place in (begin, end))
            if low < high:
                part = panels.part(low // self._size, high // self._size)
                found.append(self._moments_of(queries, distance, part, alpha, threads))
        return reduce(add, found)

    def _moments_of(
        self,
        queries: NDArray[np.float32],
        distance: NDArray[np.float64],
        panels: Panels,
        alpha: float,
        threads: int | None,
    ) -> SampleMoments:
        leverage = panels.leverage.astype(np.float64)
        sample = np.stack([leverage**power for power in range(3)]).sum(axis=1)
        if self._target is None:
            from ssil_data.kernels import chunked  # torch takes a second to load

            states = panels.unpack()
            return SampleMoments(sample, chunked.moments(queries, *states, distance, alpha=alpha))

        def answer(work: Pass, rows: NDArray[np.int64]) -> SampleMoments:
            return SampleMoments(sample, work(queries[rows], distance[rows])[0])

        return run_parallel(
            answer,
            queries,
            panels,
            Products.MOMENTS,
            target=self._target,
            alpha=alpha,
            threads=threads,
        )

    def _grow_to(self, end: int) -> list[tuple[int, Panels]]:
        """Return the parts that have the first `end` references, and where each begins."""
        with self._growing:
            if self._order is None:
                order = np.random.default_rng(self._seed).permutation(self._states.shape[0])
                self._order = order[: self.max_size].astype(np.uint32)
            starts = [0]
            while starts[-1] < end:
                first = starts[-1]
                size = min(max(FIRST_PART, first), self.max_size - first)
                if len(self._parts) < len(starts):
                    self._parts.append(self._pack(self._order[first : first + size]))
                starts.append(first + size)
            return list(zip(starts, self._parts, strict=False))

    def _pack(self, chosen: NDArray[np.integer]) -> Panels:
        """Read in ascending order, so that mapped files are read forwards; pack in random order."""
        forwards = np.argsort(chosen)
        states = np.empty((len(chosen), self._states.shape[1]), np.float32)
        states[forwards] = self._states[chosen[forwards].astype(np.int64)]
        leverage = self._leverage[chosen] - np.float32(self._mean)
        return Panels.of(states, self._center, leverage, self._size)
