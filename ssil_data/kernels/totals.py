r"""The sum of a query's distances to all references, from tables: O(d), whatever their number.

In one dimension F(q) = Σ_j l_j |q − x_j| with l_j ≥ 0 is known exactly but for the references in
the same bin of the table as q. Their part of F is convex in q and, by that and by the triangle
inequality, lies between

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
_AT_ONCE, _QUERIES = 1 << 18, 1024


@dataclass(frozen=True, eq=False)
class DistanceSums:
    """Σ_j d_j and Σ_j l_j d_j over all references, for each of m queries, with error bounds."""

    plain: NDArray[np.float64]
    weighted: NDArray[np.float64]
    plain_error: NDArray[np.float64]
    weighted_error: NDArray[np.float64]

    def take(self, rows: NDArray[np.int64]) -> DistanceSums:
        """Return the sums of the queries `rows`."""
        return DistanceSums(*(getattr(self, field.name)[rows] for field in fields(self)))


class Totals:
    """Tables (4, d, bins) of Σ 1, Σ x, Σ l, Σ l x below each bin of centered references."""

    def __init__(self, states: Rows, leverage: NDArray[np.float32], center: NDArray) -> None:
        """Read states (n, d) twice, in parts; leverage (n,) ≥ 0."""
        count, width = states.shape
        parts = [slice(i, i + _AT_ONCE) for i in range(0, count, _AT_ONCE)]
        reach = max(np.abs(states[part] - center).max() for part in parts)
        self._bins = _magnitude(np.array([reach]))[0] + 1
        table = np.zeros((4, width, 2 * self._bins))
        for part in parts:
            rows, weights = states[part] - center, leverage[part].astype(np.float64)
            for i, column in enumerate(np.ascontiguousarray(rows.T)):
                bins = self._bin(column)
                values = column.astype(np.float64)
                for j, added in enumerate((None, values, weights, weights * values)):
                    table[j, i] += np.bincount(bins, added, minlength=2 * self._bins)
        self._below = np.concatenate([np.zeros((4, width, 1)), table.cumsum(axis=2)], axis=2)

    def __call__(self, queries: NDArray[np.float32]) -> DistanceSums:
        """Return the sums for centered queries (m, d)."""
        parts = [
            self._of(part) for part in np.split(queries, range(_QUERIES, len(queries), _QUERIES))
        ]
        columns = ([getattr(part, name.name) for part in parts] for name in fields(DistanceSums))
        return DistanceSums(*map(np.concatenate, columns))

    def _of(self, queries: NDArray[np.float32]) -> DistanceSums:
        q = queries.astype(np.float64)
        bins = np.clip(self._bin(queries), 0, 2 * self._bins - 1)
        dimensions = np.arange(queries.shape[1])
        low, high = self._edges(bins)
        found = []
        below, with_bin = (self._below[:, dimensions, place] for place in (bins, bins + 1))
        all_of_them = self._below[:, :, -1]
        for weight, moment in ((0, 1), (2, 3)):
            (w_low, w_high, w_all), (x_low, x_high, x_all) = (
                [part[kind] for part in (below, with_bin, all_of_them)] for kind in (weight, moment)
            )
            outside = q * w_low - x_low + (x_all - x_high) - q * (w_all - w_high)
            w, x = w_high - w_low, x_high - x_low
            least = np.abs(q * w - x)
            share = np.clip((q - low) / (high - low), 0, 1)
            chord = (1 - share) * (x - low * w) + share * (high * w - x)
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
        positive = bins >= self._bins
        magnitude = np.where(positive, bins - self._bins, self._bins - 1 - bins)
        near, far = _edge(magnitude), _edge(magnitude + 1)
        return np.where(positive, near, -far), np.where(positive, far, -near)


def _magnitude(values: NDArray[np.float32]) -> NDArray[np.intp]:
    """Return how many edges lie between 0 and |values|: the leading bits of 1 + |values|."""
    bits = (np.abs(values) + np.float32(1)).astype(np.float32).view(np.int32)
    return (bits >> (23 - _BITS)).astype(np.intp) - (127 << _BITS)


def _edge(magnitude: NDArray[np.intp]) -> NDArray[np.float64]:
    bits = (magnitude + (127 << _BITS)).astype(np.int32) << (23 - _BITS)
    return bits.view(np.float32).astype(np.float64) - 1
