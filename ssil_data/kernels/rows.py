"""How the engine reads states, in parts, and the center that it subtracts from them."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Rows(Protocol):
    """States (n, d) float32 that can be read in parts: an array, a mapped file, a view."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Return (n, d)."""
        ...

    def __getitem__(self, rows: slice | NDArray[np.int64], /) -> NDArray[np.float32]:
        """Return some states, (·, d): a slice, or those of the given indices."""
        ...


def find_center(states: Rows) -> NDArray[np.float32]:
    """Return a center near the mean, so round that float32 subtracts it without losing bits.

    It is the mean rounded to a power of two near the standard deviation, in each dimension, both
    measured on a sample of about 4,096 states.

    Parameters
    ----------
    states
        States (n, d), n ≥ 1.

    Returns
    -------
    NDArray
        Center (d,), in the units of the states.
    """
    sample = states[:: 1 + states.shape[0] // 4096].astype(np.float64)
    grain = np.exp2(np.floor(np.log2(np.maximum(sample.std(axis=0), 2.0**-60))))
    return (np.rint(sample.mean(axis=0) / grain) * grain).astype(np.float32)
