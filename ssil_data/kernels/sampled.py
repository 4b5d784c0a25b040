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
from ssil_data.kernels.references import HOST, MIN_COMPILED_ALPHA, References
from ssil_data.kernels.regression import Population, SampleMoments, estimate
from ssil_data.kernels.rows import Rows, find_center
from ssil_data.kernels.sample import FIRST_PART, Sample
from ssil_data.kernels.totals import Totals

MIN_STATES_TO_SAMPLE = 8 * FIRST_PART
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
        self._center, self._population = find_center(states), Population.of(leverage)
        self._target, self._lock = target, Lock()
        self._samples = lru_cache(maxsize=1)(self._draw_sample)

    @cached_property
    def _totals(self) -> Totals:
        return Totals(self._states, self._leverage, self._center)

    def prepare(self) -> Totals:
        """Read what is to be known of all states, if that is not done yet."""
        with self._lock:
            return self._totals

    def estimate_within(
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
        if self._exact_is_faster(queries, alpha):
            return self._answer_exactly(queries, alpha, threads)
        asked = self._estimate_queries(queries, alpha, seed, threads)
        found, left = Estimate.empty(len(queries)), np.arange(len(queries))
        exactly, size = [], asked.sample.round_up(FIRST_PART)
        while len(left):
            answer = asked.estimate_with(size, left)
            need = answer.required_size(tolerance, size, self._population.count)
            done, hopeless = need <= size, ~(need <= asked.sample.max_size)
            found.write(left[done], answer.take(done))
            exactly.append(left[hopeless & ~done])
            left = left[~done & ~hopeless]
            size = asked.sample.round_up(size * _GROWTH)
        rows = np.concatenate(exactly)
        if len(rows):
            found.write(rows, self._answer_exactly(queries[rows], alpha, threads))
        return found

    def estimate_in_time(
        self,
        queries: NDArray[np.float32],
        *,
        alpha: float,
        seconds: float,
        seed: int = 0,
        threads: int | None = None,
    ) -> Estimate:
        """Answer queries (m, d) from as large a sample as `seconds` allow, exactly if they do.

        Every sample has `FIRST_PART` states at least; what is to be known of all states is not in the
        time. An answer that too few of a sample decide has the widest half-width there is: to the
        farther end of the leverage.
        """
        left = np.arange(len(queries))
        if self._exact_is_faster(queries, alpha):
            return self._answer_exactly(queries, alpha, threads)
        asked = self._estimate_queries(queries, alpha, seed, threads)
        begin = time.perf_counter()
        size = asked.sample.round_up(FIRST_PART)
        answer = asked.estimate_with(size, left)
        while size < asked.sample.max_size:
            spent = time.perf_counter() - begin
            affordable = size * seconds / spent
            if affordable > self._population.count:
                return self._answer_exactly(queries, alpha, threads)
            larger = asked.sample.round_up(min(2 * size, affordable))
            if larger <= size:
                break
            size, answer = larger, asked.estimate_with(larger, left)
        widest = self._population.farthest(answer.values)
        return replace(
            answer,
            deviation=np.where(answer.trusted, answer.deviation, 0),
            floor=np.where(answer.trusted, answer.floor, widest),
        )

    def estimate_of_size(
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
        return asked.estimate_with(asked.sample.round_up(size), np.arange(len(queries)))

    def deviation(self, queries: NDArray[np.float32], *, alpha: float) -> float:
        """Return the standard deviation of LCoR over queries (m, d), noise of samples taken off."""
        if self._exact_is_faster(queries, alpha):
            return float(self._answer_exactly(queries, alpha, None).values.std())
        found = self.estimate_of_size(queries, alpha=alpha, size=4 * FIRST_PART)
        if not found.trusted.all():
            return float(self._answer_exactly(queries, alpha, None).values.std())
        variance = found.values.var() - np.square(found.deviation).mean()
        return float(np.sqrt(max(variance, 0.0)))

    def _exact_is_faster(self, queries: NDArray[np.float32], alpha: float) -> bool:
        return (
            not len(queries)
            or self._population.count < MIN_STATES_TO_SAMPLE
            or alpha < MIN_COMPILED_ALPHA
        )

    def _draw_sample(self, seed: int) -> Sample:
        mean = self._population.mean
        return Sample(
            self._states, self._leverage, self._center, mean, seed=seed, target=self._target
        )

    def _estimate_queries(
        self, queries: NDArray[np.float32], alpha: float, seed: int, threads: int | None
    ) -> _QueryEstimates:
        totals = self.prepare()
        with self._lock:
            sample = self._samples(seed)
        centered = np.ascontiguousarray(queries - self._center)
        return _QueryEstimates(sample, totals, self._population, centered, alpha, threads)

    def _answer_exactly(
        self, queries: NDArray[np.float32], alpha: float, threads: int | None
    ) -> Estimate:
        sums = self._exact().sums(queries, alpha=alpha, threads=threads)
        size, none = sums.effective_sample_size, np.zeros(len(queries))
        return Estimate(sums.values, none, none, size, size, none)


class _QueryEstimates:
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

    def estimate_with(self, size: int, rows: NDArray[np.int64]) -> Estimate:
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
