"""The engine behind LCoR: references, packed once, and exact sums over all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.exact import exact_sums
from ssil_data.kernels.native import Target
from ssil_data.kernels.panels import Panels
from ssil_data.kernels.passes import Pass, run_parallel
from ssil_data.kernels.products import Products
from ssil_data.kernels.rows import Rows, find_center
from ssil_data.kernels.sums import Sums

HOST = Target.host()
"""The processor at hand; None where code cannot be written for it."""
MIN_COMPILED_ALPHA = 1e-3
"""Sharpness below which float32 cannot hold t = (α + d) / (α + d₀): torch answers in float64."""
MAX_COMPILED_ALPHA = 1e12
"""Sharpness from which on the kernel is exp(−d/2) to float32: larger ones are taken for it."""


class References:
    """References with their leverages, centered and packed for one processor.

    Parameters
    ----------
    states
        States (n, d), n ≥ 1; they are read in parts.
    leverage
        Leverages (n,).
    target
        Processor to write code for. With None, as on processors that no tile is known for, plain
        torch computes the sums.
    device
        One of torch's devices; any but "cpu" has plain torch compute the sums there.
    """

    def __init__(
        self,
        states: Rows,
        leverage: NDArray[np.float32],
        *,
        target: Target | None = HOST,
        device: str = "cpu",
    ) -> None:
        self._center = find_center(states)
        self._mean = float(leverage.mean(dtype=np.float64))
        self._target = target if device == "cpu" else None
        # sums of small numbers around 0 lose less to rounding; `sums` adds the mean again
        centered = leverage - np.float32(self._mean)
        if self._target is None:
            from ssil_data.kernels import chunked  # torch takes a second to load

            self._tensors = chunked.Tensors.of(states, self._center, centered, device)
        else:
            size = self._target.tile.references
            self._panels = Panels.of(states, self._center, centered, size)

    def sums(
        self,
        queries: NDArray[np.float32],
        *,
        alpha: float,
        contributors: int = 0,
        threads: int | None = None,
    ) -> Sums:
        """Return the sums of equation 5 over all references.

        Compiled code gives a query the same bits whatever other queries the call has and however
        many threads share it; plain torch, and so any α below MIN_COMPILED_ALPHA, does not.

        Parameters
        ----------
        queries
            Queries (m, d), in the units of the references.
        alpha
            Sharpness of the kernel, > 0.
        contributors
            How many of the heaviest references to name in `Sums.nearest`.
        threads
            Threads to share the work; by default all processors that this process may use, where
            there is work for them.
        """
        centered = np.ascontiguousarray(queries - self._center)
        if self._target is None:
            sums = self._tensors.sums(centered, alpha=alpha, contributors=contributors)
        elif not len(queries):
            sums = Sums.empty(min(contributors, self._panels.count))
        elif alpha < MIN_COMPILED_ALPHA:
            from ssil_data.kernels import chunked

            sums = chunked.lcor_sums(
                centered, *self._panels.unpack(), alpha=alpha, contributors=contributors
            )
        else:
            sums = self._run_compiled(
                centered, self._target, min(alpha, MAX_COMPILED_ALPHA), contributors, threads
            )
        return replace(sums, numerator=sums.numerator + self._mean * sums.denominator)

    def _run_compiled(
        self,
        queries: NDArray[np.float32],
        target: Target,
        alpha: float,
        contributors: int,
        threads: int | None,
    ) -> Sums:
        def answer(work: Pass, rows: NDArray[np.int64]) -> Sums:
            return exact_sums(work, queries[rows], contributors=contributors)

        return run_parallel(
            answer,
            queries,
            self._panels,
            Products.SUMS,
            target=target,
            alpha=alpha,
            threads=threads,
        )


def lcor_sums(
    queries: NDArray[np.float32],
    states: NDArray[np.float32],
    leverage: NDArray[np.float32],
    *,
    alpha: float,
    contributors: int = 0,
) -> Sums:
    """Return the sums of equation 5 over references that are needed for this call alone.

    Parameters
    ----------
    queries
        Queries (m, d), standardized; below 1e6 or so.
    states
        References (n, d), n ≥ 1, likewise.
    leverage
        Leverages (n,).
    alpha
        Sharpness of the kernel, > 0.
    contributors
        How many of the heaviest references to name.
    """
    return References(states, leverage).sums(queries, alpha=alpha, contributors=contributors)
