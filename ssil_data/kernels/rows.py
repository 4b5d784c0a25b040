"""What the engine reads: states in parts."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Rows(Protocol):
    """States (n, d) float32 to be read in parts: an array, a mapped file, a view that converts."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Return (n, d)."""
        ...

    def __getitem__(self, rows: slice | NDArray[np.int64], /) -> NDArray[np.float32]:
        """Return some of them."""
        ...


def find_center(states: Rows) -> NDArray[np.float32]:
    """Return about the mean (d,), so round that subtracting it loses no bits.

    It is a whole multiple of a power of two near the deviation; a sample tells both.
    """
    sample = states[:: 1 + states.shape[0] // 4096].astype(np.float64)
    grain = np.exp2(np.floor(np.log2(np.maximum(sample.std(axis=0), 2.0**-60))))
    return (np.rint(sample.mean(axis=0) / grain) * grain).astype(np.float32)
