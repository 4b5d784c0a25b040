"""LCoR over very many references from a random part of them, as exact as was asked for."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.estimates import Estimate
from ssil_data.kernels.native import Target
from ssil_data.kernels.references import FLATTEST, HOST, References
from ssil_data.kernels.regression import Population, SampleMoments, estimate
from ssil_data.kernels.rows import Rows, center
from ssil_data.kernels.sample import FIRST, Sample
from ssil_data.kernels.totals import Totals

SMALLEST = 8 * FIRST
"""States below which exact sums are the shorter way."""
_GROWTH = 2**0.5
"""Samples grow on one ladder, so that an answer depends on its own query alone."""


class Sampled:
    """States (n, d) with their leverage (n,), of which a random part is asked.

    `exact` answers from all of them. Equal seeds draw equal samples, of which the latest is kept,
    and give equal answers, to the last bit where `References` does: whatever else is asked, and by
    however many threads. What is to be known of all states is read when it is first needed.
    """

    def __init__(
        self,
        states: Rows,
        leverage: NDArray[np.float32],
        exact: Callable[[], References],
        *,
        target: Target | None = HOST,
    ) -> None:
        self._states, self._leverage, self._exact = states, leverage, exact
        self._centre, self._population = center(states), Population.of(leverage)
        self._target, self._lock = target, Lock()
        self._samples = lru_cache(maxsize=1)(self._draw)

    @cached_property
    def _totals(self) -> Totals:
        return Totals(self._states, self._leverage, self._centre)

    def prepare(self) -> Totals:
        """Read what is to be known of all states, if that is not done yet."""
        with self._lock:
            return self._totals

    def within(
        self,
        queries: NDArray[np.float32],
        *,
        alpha: float,
        tolerance: float,
        seed: int = 0,
        threads: int | None = None,
    ) -> Estimate:
        """Answer queries (m, d) with 99.9 % half-widths of at most `tolerance` > 0.

        The sample grows until it is large enough for a query. Queries that would take more than a
        quarter of the states are answered exactly, and so are all where that is the shorter way.
        """
        if self._is_short(queries, alpha):
            return self._exactly(queries, alpha, threads)
        asked = self._estimate_queries(queries, alpha, seed, threads)
        found, left = Estimate.blank(len(queries)), np.arange(len(queries))
        exactly, size = [], asked.sample.whole(FIRST)
        while len(left):
            answer = asked.upto(size, left)
            need = answer.size_for(tolerance, size, self._population.count)
            done, hopeless = need <= size, ~(need <= asked.sample.largest)
            found.write(left[done], answer.take(done))
            exactly.append(left[hopeless & ~done])
            left = left[~done & ~hopeless]
            size = asked.sample.whole(size * _GROWTH)
        rows = np.concatenate(exactly)
        if len(rows):
            found.write(rows, self._exactly(queries[rows], alpha, threads))
        return found

    def in_time(
        self,
        queries: NDArray[np.float32],
        *,
        alpha: float,
        seconds: float,
        seed: int = 0,
        threads: int | None = None,
    ) -> Estimate:
        """Answer queries (m, d) from as large a sample as `seconds` allow, exactly if they do.

        Every sample has `FIRST` states at least; what is to be known of all states is not in the
        time. An answer that too few of a sample decide has the widest half-width there is: to the
        farther end of the leverage.
        """
        left = np.arange(len(queries))
        if self._is_short(queries, alpha):
            return self._exactly(queries, alpha, threads)
        asked = self._estimate_queries(queries, alpha, seed, threads)
        begin = time.perf_counter()
        size = asked.sample.whole(FIRST)
        answer = asked.upto(size, left)
        while size < asked.sample.largest:
            spent = time.perf_counter() - begin
            affordable = size * seconds / spent
            if affordable > self._population.count:
                return self._exactly(queries, alpha, threads)
            larger = asked.sample.whole(min(2 * size, affordable))
            if larger <= size:
                break
            size, answer = larger, asked.upto(larger, left)
        widest = self._population.farthest(answer.values)
        return replace(
            answer,
            deviation=np.where(answer.trusted, answer.deviation, 0),
            floor=np.where(answer.trusted, answer.floor, widest),
        )

    def of_size(
        self,
        queries: NDArray[np.float32],
        *,
        alpha: float,
        size: int,
        seed: int = 0,
        threads: int | None = None,
    ) -> Estimate:
        """Answer queries (m, d) from a sample of about `size` states, whatever that gives."""
        asked = self._estimate_queries(queries, alpha, seed, threads)
        return asked.upto(asked.sample.whole(size), np.arange(len(queries)))

    def deviation(self, queries: NDArray[np.float32], *, alpha: float) -> float:
        """Return the standard deviation of LCoR over queries (m, d), noise of samples taken off."""
        if self._is_short(queries, alpha):
            return float(self._exactly(queries, alpha, None).values.std())
        found = self.of_size(queries, alpha=alpha, size=4 * FIRST)
        if not found.trusted.all():
            return float(self._exactly(queries, alpha, None).values.std())
        variance = found.values.var() - np.square(found.deviation).mean()
        return float(np.sqrt(max(variance, 0.0)))

    def _is_short(self, queries: NDArray[np.float32], alpha: float) -> bool:
        return not len(queries) or self._population.count < SMALLEST or alpha < FLATTEST

    def _draw(self, seed: int) -> Sample:
        mean = self._population.mean
        return Sample(
            self._states, self._leverage, self._centre, mean, seed=seed, target=self._target
        )

    def _estimate_queries(
        self, queries: NDArray[np.float32], alpha: float, seed: int, threads: int | None
    ) -> _Asked:
        totals = self.prepare()
        with self._lock:
            sample = self._samples(seed)
        centred = np.ascontiguousarray(queries - self._centre)
        return _Asked(sample, totals, self._population, centred, alpha, threads)

    def _exactly(self, queries: NDArray[np.float32], alpha: float, threads: int | None) -> Estimate:
        sums = self._exact().sums(queries, alpha=alpha, threads=threads)
        size, none = sums.effective_sample_size, np.zeros(len(queries))
        return Estimate(sums.values, none, none, size, size, none)


class _Asked:
    """Queries and what a growing sample has told of them so far."""

    def __init__(
        self,
        sample: Sample,
        totals: Totals,
        population: Population,
        queries: NDArray[np.float32],
        alpha: float,
        threads: int | None,
    ) -> None:
        self.sample, self._population, self._queries = sample, population, queries
        self._alpha, self._threads = alpha, threads
        self._totals = totals(queries)
        self._distance = self._totals.plain / population.count
        self._seen, self._size = SampleMoments.zero(len(queries)), 0

    def upto(self, size: int, rows: NDArray[np.int64]) -> Estimate:
        """Let the sample grow to `size` for the queries `rows`, and answer them."""
        grown = self.sample.moments(
            self._queries[rows],
            self._distance[rows],
            self._size,
            size,
            alpha=self._alpha,
            threads=self._threads,
        )
        self._seen.sample[:] += grown.sample
        self._seen.products[:, rows] += grown.products
        self._size = size
        totals = self._totals.take(rows)
        return estimate(self._seen.take(rows), totals, self._population, self._alpha)
