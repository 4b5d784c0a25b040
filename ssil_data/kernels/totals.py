r"""The sums of a query's distances to all references, from tables: O(d), however many they are.

The L1 distance is a sum over dimensions, so each dimension has a table of its own. In one of them,
F(q) = Σ_j l_j |q − x_j| with l_j ≥ 0 is known exactly from sums below and above q, but for the
references in the same bin of the table as q. Their part of F is convex in q and, by that and by the
triangle inequality, lies between

    its chord over the bin   and   |q Σ l − Σ l x|.

The middle of the two is the answer, half of their difference a bound of its error.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.rows import Rows

_BITS = 9
"""A bin's width is 2^−9 of its distance from the center plus one."""
CHUNK_ROWS = 1 << 18
"""References that are read at a time."""
CHUNK_QUERIES = 1024
"""Queries that are looked up at a time."""


@dataclass(frozen=True, eq=False)
class DistanceSums:
    """Sums over all references for m queries: plain Σ d and weighted Σ l d, with error bounds.

    All fields are (m,); the true sums lie within value ± error, but for the rounding of float64.
    """

    plain: NDArray[np.float64]
    weighted: NDArray[np.float64]
    plain_error: NDArray[np.float64]
    weighted_error: NDArray[np.float64]

    def take(self, rows: NDArray[np.int64]) -> DistanceSums:
        """Return the sums of some of the queries.

        Parameters
        ----------
        rows
            Indices of queries, in the order wanted.
        """
        return DistanceSums(*(getattr(self, field.name)[rows] for field in fields(self)))


class Totals:
    """Tables of Σ 1, Σ x, Σ l and Σ l x over the centered references below each bin.

    `_below` is (4, d, bins + 1). Bins are numbered from the farthest below the center upwards; half
    of them are negative.

    Parameters
    ----------
    states
        References (n, d), n ≥ 1; they are read twice, in parts.
    leverage
        Leverages (n,), ≥ 0.
    center
        Subtracted from the states, (d,).
    """

    def __init__(self, states: Rows, leverage: NDArray[np.float32], center: NDArray) -> None:
        count, width = states.shape
        parts = [slice(i, i + CHUNK_ROWS) for i in range(0, count, CHUNK_ROWS)]
        reach = max(np.abs(states[part] - center).max() for part in parts)
        self._bins = _magnitude(np.array([reach]))[0] + 1
        table = np.zeros((4, width, 2 * self._bins))
        for part in parts:
            rows = states[part] - center
            weights = leverage[part].astype(np.float64)
            for i, column in enumerate(np.ascontiguousarray(rows.T)):
                bins = self._bin(column)
                values = column.astype(np.float64)
                for j, added in enumerate((None, values, weights, weights * values)):
                    table[j, i] += np.bincount(bins, added, minlength=2 * self._bins)
        self._below = np.concatenate([np.zeros((4, width, 1)), table.cumsum(axis=2)], axis=2)

    def __call__(self, queries: NDArray[np.float32]) -> DistanceSums:
        """Return the sums of distances of centered queries (m, d), in O(d) for each."""
        cuts = range(CHUNK_QUERIES, len(queries), CHUNK_QUERIES)
        parts = [self._sum_distances(part) for part in np.split(queries, cuts)]
        columns = ([getattr(part, name.name) for part in parts] for name in fields(DistanceSums))
        return DistanceSums(*map(np.concatenate, columns))

    def _sum_distances(self, queries: NDArray[np.float32]) -> DistanceSums:
        q = queries.astype(np.float64)
        bins = np.clip(self._bin(queries), 0, 2 * self._bins - 1)
        dimensions = np.arange(queries.shape[1])
        low, high = self._edges(bins)
        found = []
        # sums below the query's bin, sums below and in it, and sums over all references
        below, with_bin = (self._below[:, dimensions, place] for place in (bins, bins + 1))
        whole = self._below[:, :, -1]
        for weight, moment in ((0, 1), (2, 3)):
            (w_low, w_high, w_all), (x_low, x_high, x_all) = (
                [part[kind] for part in (below, with_bin, whole)] for kind in (weight, moment)
            )
            outside = q * w_low - x_low + (x_all - x_high) - q * (w_all - w_high)
            w = w_high - w_low
            x = x_high - x_low
            least = np.abs(q * w - x)
            share = np.clip((q - low) / (high - low), 0, 1)
            chord = (1 - share) * (x - low * w) + share * (high * w - x)
            # on the edge of a bin, or beyond the last one, nothing is left to estimate
            most = np.where((q > low) & (q < high), chord, least)
            most = np.maximum(most, least)
            found.append((outside + (least + most) / 2).sum(axis=1))
            found.append(((most - least) / 2).sum(axis=1))
        return DistanceSums(found[0], found[2], found[1], found[3])

    def _bin(self, values: NDArray[np.float32]) -> NDArray[np.intp]:
        """Number the bins from the farthest below the center to the farthest above."""
        magnitude = _magnitude(values)
        return np.where(values < 0, self._bins - 1 - magnitude, self._bins + magnitude)

    def _edges(self, bins: NDArray[np.intp]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the lower and the upper edges of bins."""
        positive = bins >= self._bins
        magnitude = np.where(positive, bins - self._bins, self._bins - 1 - bins)
        near = _edge(magnitude)
        far = _edge(magnitude + 1)
        return np.where(positive, near, -far), np.where(positive, far, -near)


def _magnitude(values: NDArray[np.float32]) -> NDArray[np.intp]:
    """Return how many edges lie between 0 and |values|: the leading bits of 1 + |values|."""
    bits = (np.abs(values) + np.float32(1)).astype(np.float32).view(np.int32)
    return (bits >> (23 - _BITS)).astype(np.intp) - (127 << _BITS)


def _edge(magnitude: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the distance of an edge from 0, given how many edges lie between: undoes the above."""
    bits = (magnitude + (127 << _BITS)).astype(np.int32) << (23 - _BITS)
    return bits.view(np.float32).astype(np.float64) - 1
