"""Estimates of some queries that become more exact as the sample grows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.estimates import Estimate
from ssil_data.kernels.moments import Population, SampleMoments
from ssil_data.kernels.regression import estimate
from ssil_data.kernels.sample import Sample
from ssil_data.kernels.totals import DistanceSums


class QueryEstimates:
    """Queries with the moments about them of a sample that grows.

    Parameters
    ----------
    sample
        The sample.
    population
        Of the leverages of all references.
    queries
        Centered queries (m, d).
    totals
        Sums of distances from the queries to all references.
    alpha
        Sharpness of the kernel, > 0.
    threads
        Threads to share the work; None for all processors.
    """

    def __init__(
        self,
        sample: Sample,
        population: Population,
        queries: NDArray[np.float32],
        *,
        totals: DistanceSums,
        alpha: float,
        threads: int | None,
    ) -> None:
        self.sample = sample
        self._population = population
        self._queries = queries
        self._totals = totals
        self._alpha = alpha
        self._threads = threads
        self._distance = totals.plain / population.count
        self._moments = SampleMoments.zero(len(queries))
        self._size = 0

    def estimate_with(self, size: int, rows: NDArray[np.int64]) -> Estimate:
        """Estimate some of the queries from a larger sample than before.

        Parameters
        ----------
        size
            References in the sample; it must not shrink.
        rows
            Indices of queries. Those left out once must not come back: their moments lag behind.
        """
        grown = self.sample.moments(
            self._queries[rows],
            self._distance[rows],
            self._size,
            size,
            alpha=self._alpha,
            threads=self._threads,
        )
        self._moments.sample[:] += grown.sample
        self._moments.products[:, rows] += grown.products
        self._size = size
        totals = self._totals.take(rows)
        return estimate(self._moments.take(rows), totals, self._population, self._alpha)
