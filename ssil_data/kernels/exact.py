"""LCoR's exact sums of a few queries over one shard of packed references, by compiled code."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.formulas import log_kernel
from ssil_data.kernels.native import Code
from ssil_data.kernels.panels import Panels
from ssil_data.kernels.sums import Sums

_SPAN = 24 * np.log(2)
"""How far the log of the largest weight may lie from 0 before float32 loses the smaller ones."""


@dataclass(frozen=True)
class ExactSums:
    """What to compute: compiled code, α, and how many contributors to name."""

    code: Code
    alpha: float
    contributors: int

    def __call__(self, queries: NDArray[np.float32], panels: Panels) -> Sums:
        """Return the sums for centred queries (m, d), m ≥ 1.

        Weights are first taken relative to the kernel at a query's distance to the centre. Where
        that is out of the range of float32 (large α, far from the data), they are taken again,
        relative to the nearest reference, which is known by then.
        """
        to_centre = np.abs(queries).sum(axis=1, dtype=np.float64)
        sums, brackets = self._relative(queries, to_centre, panels)
        nearest = self._distance(queries, brackets.min(axis=1))
        log_weight = log_kernel(nearest, self.alpha) - log_kernel(to_centre, self.alpha)
        lost = np.abs(log_weight) > _SPAN
        if lost.any():
            sums[:, lost], _ = self._relative(queries[lost], nearest[lost], panels)
            log_weight[lost] = 0
        numerator, denominator, squares = sums * np.exp(-log_weight * [[1], [1], [2]])
        log_scale = log_kernel(nearest, self.alpha)
        rows, distances = self._top(queries, brackets, panels)
        weights = np.exp(log_kernel(distances, self.alpha) - log_scale[:, None])
        return Sums(numerator, denominator, squares, log_scale, rows, weights)

    def _relative(
        self, queries: NDArray[np.float32], distance: NDArray[np.float64], panels: Panels
    ) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Return Σ l w, Σ w, Σ w² (3, m), and the smallest bracket in each panel (m, ·).

        w is the kernel relative to that at `distance` (m,).
        """
        factor = (1 if self.code.direct else 2) / (self.alpha + distance)
        offset = (self._distance(queries, 0) - distance) / (self.alpha + distance)
        columns = [queries, factor[:, None], offset[:, None] + self.code.power.offset]
        rows, per_tile = np.concatenate(columns, axis=1, dtype=np.float32), self.code.tile.queries
        tiles = -(-len(rows) // per_tile)
        filled = rows[np.minimum(np.arange(tiles * per_tile), len(rows) - 1)]
        packed = np.ascontiguousarray(filled.reshape(tiles, per_tile, -1).transpose(0, 2, 1))
        sums = np.zeros((tiles, 3, per_tile))
        brackets = np.empty((tiles * per_tile, len(panels.values)), np.float32)
        self.code(panels.values, packed, sums, brackets, exponent=(self.alpha + 1) / 2)
        return sums.transpose(1, 0, 2).reshape(3, -1)[:, : len(rows)], brackets[: len(rows)]

    def _distance(
        self, queries: NDArray[np.float32], bracket: NDArray[np.float32] | float
    ) -> NDArray[np.float64]:
        """Return the distances that brackets (m,) stand for; rounding may leave them below 0."""
        if self.code.direct:
            return np.zeros(len(queries)) + bracket
        return 2.0 * np.asarray(bracket, np.float64) - queries.sum(axis=1, dtype=np.float64)

    def _top(
        self, queries: NDArray[np.float32], brackets: NDArray[np.float32], panels: Panels
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Return rows and distances (m, c) of the nearest: they lie in the c nearest panels."""
        count = min(self.contributors, panels.count)
        rows = np.empty((len(queries), count), np.int64)
        distances = np.empty((len(queries), count), np.float32)
        last = min(count, len(panels.values)) - 1
        for i in range(len(queries)) if count else ():
            chosen = np.argpartition(brackets[i], last)[: last + 1]
            rows[i], distances[i] = panels.nearest(queries[i], chosen, count)
        return rows, distances
