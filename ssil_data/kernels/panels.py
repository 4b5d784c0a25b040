"""References packed in the order in which the compiled code reads them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.rows import Rows

_NOWHERE = 1e30
"""First coordinate of the rows that fill up the last panel: so far away that they weigh 0."""
CHUNK_PANELS = 1024
"""Panels that are packed at a time: more would only take more memory."""


@dataclass(frozen=True, eq=False)
class Panels:
    """`count` centered references in panels of `size`: values (panels, d + 2, size) float32.

    The rows of a panel are the d dimensions, then −Σx/2, then the leverage, each for `size`
    references. What fills up the last panel is so far away that it weighs nothing.
    """

    values: NDArray[np.float32]
    count: int

    @classmethod
    def of(
        cls, states: Rows, center: NDArray[np.float32], leverage: NDArray[np.float32], size: int
    ) -> Panels:
        """Pack references; their states are read in parts.

        Parameters
        ----------
        states
            States (n, d), n ≥ 1.
        center
            Subtracted from the states, (d,).
        leverage
            Leverages (n,).
        size
            References in a panel.
        """
        count, width = states.shape
        panels = -(-count // size)
        values = _align((panels, width + 2, size))
        for begin in range(0, panels, CHUNK_PANELS):
            part = values[begin : begin + CHUNK_PANELS]
            rows = slice(begin * size, (begin + len(part)) * size)
            padded = np.zeros((len(part) * size, width + 2), np.float32)
            read = states[rows]
            known = padded[: len(read)]
            known[:, :width] = read - center
            known[:, width + 1] = leverage[rows]
            padded[len(known) :, 0] = _NOWHERE
            padded[:, width] = padded[:, :width].sum(axis=1, dtype=np.float64) / -2
            part[:] = padded.reshape(len(part), size, width + 2).transpose(0, 2, 1)
        return cls(values, count)

    @property
    def width(self) -> int:
        """Number d of dimensions."""
        return self.values.shape[1] - 2

    @property
    def size(self) -> int:
        """Number of references in a panel."""
        return self.values.shape[2]

    def part(self, begin: int, end: int) -> Panels:
        """Return some of the panels; nothing is copied.

        Parameters
        ----------
        begin, end
            First panel, and the one after the last.
        """
        count = min(self.count - begin * self.size, (end - begin) * self.size)
        return Panels(self.values[begin:end], count)

    @property
    def leverage(self) -> NDArray[np.float32]:
        """The leverages (n,) that were packed."""
        return self.values[:, self.width + 1].reshape(-1)[: self.count]

    def unpack(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the centered states (n, d) and the leverages (n,) that were packed."""
        rows = self.values.transpose(0, 2, 1).reshape(-1, self.width + 2)[: self.count]
        return np.ascontiguousarray(rows[:, : self.width]), self.leverage

    def nearest(
        self, query: NDArray[np.float32], chosen: NDArray[np.int64], count: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Return the references of some panels that are nearest to a query.

        Parameters
        ----------
        query
            Centered query (d,).
        chosen
            Panels to look into.
        count
            How many references to return; the panels have at least so many.

        Returns
        -------
        rows, distances
            Each (count,), the nearest first, and of equals the one of the lower row.
        """
        offsets = self.values[chosen, : self.width] - query[:, None]
        distance = np.abs(offsets, out=offsets).sum(axis=1).ravel()
        near = np.flatnonzero(distance <= np.partition(distance, count - 1)[count - 1])
        row = chosen[near // self.size] * self.size + near % self.size
        order = np.lexsort((row, distance[near]))[:count]
        return row[order], distance[near[order]]


def _align(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return an array that begins with a cache line, so that no vector lies in two of them."""
    count = math.prod(shape)
    line = 64
    memory = np.empty(count * 4 + line, np.uint8)
    start = -memory.ctypes.data % line
    return memory[start : start + count * 4].view(np.float32).reshape(shape)
