"""LCoR over very many references from a random sample, as exact as the caller wants it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.estimates import Estimate
from ssil_data.kernels.moments import Population
from ssil_data.kernels.native import Target
from ssil_data.kernels.query_estimates import QueryEstimates
from ssil_data.kernels.references import HOST, MIN_COMPILED_ALPHA, References
from ssil_data.kernels.rows import Rows, find_center
from ssil_data.kernels.sample import FIRST_PART, Sample
from ssil_data.kernels.totals import Totals

MIN_STATES_TO_SAMPLE = 8 * FIRST_PART
"""References below which exact sums are faster than a sample."""
_GROWTH = 2**0.5
"""Samples grow by this factor; sizes are the same for all queries, so none depends on another."""


class Sampled:
    """References of which a random sample answers, and all of them where that is faster.

    Equal seeds draw equal samples, of which the latest stays in memory, and give equal answers, to
    the last bit where `References` does: whatever other queries the call has, and however many
    threads share it. The tables over all references are made when they are first needed.

    Parameters
    ----------
    states
        References (n, d), n ≥ 1; they are read in parts.
    leverage
        Leverages (n,), ≥ 0.
    exact
        Returns the `References` that answer from all of them; called where that is faster.
    target
        Processor to write code for; None for plain torch.
    """

    def __init__(
        self,
        states: Rows,
        leverage: NDArray[np.float32],
        exact: Callable[[], References],
        *,
        target: Target | None = HOST,
    ) -> None:
        self._states = states
        self._leverage = leverage
        self._exact = exact
        self._center = find_center(states)
        self._population = Population.of(leverage)
        self._target = target
        self._lock = Lock()
        self._samples = lru_cache(maxsize=1)(self._draw_sample)

    @cached_property
    def _totals(self) -> Totals:
        return Totals(self._states, self._leverage, self._center)

    def prepare(self) -> Totals:
        """Make the tables over all references, if they are not made yet."""
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
        """Estimate LCoR with half-widths (99.9 %) of at most a tolerance.

        For each query the sample grows until it is large enough. Queries that would need more than
        a quarter of the references are answered exactly, and so are all where that is faster.

        Parameters
        ----------
        queries
            Queries (m, d), in the units of the references.
        alpha
            Sharpness of the kernel, > 0.
        tolerance
            Largest half-width, > 0, in units of leverage.
        seed
            Of the sample.
        threads
            Threads to share the work; None for all processors.
        """
        if self._exact_is_faster(queries, alpha):
            return self._answer_exactly(queries, alpha, threads)
        estimates = self._estimate_queries(queries, alpha, seed, threads)
        sample = estimates.sample
        found = Estimate.empty(len(queries))
        left = np.arange(len(queries))
        too_many: list[NDArray[np.int64]] = []
        size = sample.round_up(FIRST_PART)
        while len(left):
            answer = estimates.estimate_with(size, left)
            need = answer.find_size(tolerance, size, self._population.count)
            done = need <= size
            hopeless = ~(need <= sample.max_size)
            found.write(left[done], answer.take(done))
            too_many.append(left[hopeless & ~done])
            left = left[~done & ~hopeless]
            size = sample.round_up(size * _GROWTH)
        rows = np.concatenate(too_many)
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
        """Estimate LCoR from as large a sample as the time allows; exactly, if it allows that.

        The sample has at least `FIRST_PART` references, however short the time. An estimate that
        too few references of the sample decide gets the widest half-width there is: to the farther
        end of leverage.

        Parameters
        ----------
        queries
            Queries (m, d), in the units of the references.
        alpha
            Sharpness of the kernel, > 0.
        seconds
            Time for this call, > 0; what `prepare` takes is not in it.
        seed
            Of the sample.
        threads
            Threads to share the work; None for all processors.
        """
        rows = np.arange(len(queries))
        if self._exact_is_faster(queries, alpha):
            return self._answer_exactly(queries, alpha, threads)
        estimates = self._estimate_queries(queries, alpha, seed, threads)
        sample = estimates.sample
        begin = time.perf_counter()
        size = sample.round_up(FIRST_PART)
        answer = estimates.estimate_with(size, rows)
        while size < sample.max_size:
            spent = time.perf_counter() - begin
            affordable = size * seconds / spent
            if affordable > self._population.count:
                return self._answer_exactly(queries, alpha, threads)
            larger = sample.round_up(min(2 * size, affordable))
            if larger <= size:
                break
            size = larger
            answer = estimates.estimate_with(size, rows)
        widest = self._population.farthest(answer.values)
        return replace(
            answer,
            deviation=np.where(answer.is_trusted, answer.deviation, 0),
            floor=np.where(answer.is_trusted, answer.floor, widest),
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
        """Estimate LCoR from a sample of a given size, however exact that is.

        Parameters
        ----------
        queries
            Queries (m, d), in the units of the references.
        alpha
            Sharpness of the kernel, > 0.
        size
            References in the sample; rounded up to whole panels, at most a quarter of all.
        seed
            Of the sample.
        threads
            Threads to share the work; None for all processors.
        """
        estimates = self._estimate_queries(queries, alpha, seed, threads)
        return estimates.estimate_with(estimates.sample.round_up(size), np.arange(len(queries)))

    def deviation(self, queries: NDArray[np.float32], *, alpha: float) -> float:
        """Return the standard deviation of LCoR over queries, less the noise of sampling.

        Parameters
        ----------
        queries
            Queries (m, d), in the units of the references.
        alpha
            Sharpness of the kernel, > 0.
        """
        if self._exact_is_faster(queries, alpha):
            return float(self._answer_exactly(queries, alpha, None).values.std())
        found = self.estimate_of_size(queries, alpha=alpha, size=4 * FIRST_PART)
        if not found.is_trusted.all():
            return float(self._answer_exactly(queries, alpha, None).values.std())
        variance = found.values.var() - np.square(found.deviation).mean()
        return float(np.sqrt(max(variance, 0.0)))

    def _exact_is_faster(self, queries: NDArray[np.float32], alpha: float) -> bool:
        few = not len(queries) or self._population.count < MIN_STATES_TO_SAMPLE
        return few or alpha < MIN_COMPILED_ALPHA

    def _draw_sample(self, seed: int) -> Sample:
        mean = self._population.mean
        return Sample(
            self._states, self._leverage, self._center, mean, seed=seed, target=self._target
        )

    def _estimate_queries(
        self, queries: NDArray[np.float32], alpha: float, seed: int, threads: int | None
    ) -> QueryEstimates:
        tables = self.prepare()
        with self._lock:
            sample = self._samples(seed)
        centered = np.ascontiguousarray(queries - self._center)
        return QueryEstimates(
            sample,
            self._population,
            centered,
            totals=tables(centered),
            alpha=alpha,
            threads=threads,
        )

    def _answer_exactly(
        self, queries: NDArray[np.float32], alpha: float, threads: int | None
    ) -> Estimate:
        sums = self._exact().sums(queries, alpha=alpha, threads=threads)
        size = sums.effective_sample_size
        zeros = np.zeros(len(queries))
        return Estimate(sums.values, zeros, zeros, size, size, zeros)
