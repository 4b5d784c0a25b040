"""The engine behind LCoR: reference states, packed once, and exact sums over all of them."""

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
MIN_COMPILED_ALPHA, MAX_COMPILED_ALPHA = 1e-3, 1e12
"""Below the first α, float32 does not hold t. From the second on, the kernel is exp(−d/2)."""


class References:
    """States (n, d), n ≥ 1, with their leverage (n,), centered and packed for one processor.

    `target` is the processor to write code for; None, as on unknown hosts, is plain torch, and so
    is any `device` of torch's but the processor. States are read in parts.
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
        centered = leverage - np.float32(self._mean)
        if self._target is None:
            from ssil_data.kernels import chunked  # torch takes a second to load

            self._plain = chunked.Tensors.of(states, self._center, centered, device)
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
        """Return the sums of equation 5 for queries (m, d) in the references' units.

        `contributors` > 0 also names that many of the heaviest references; `threads` defaults to
        all processors that this process may use, where there is work for them. Code written for a
        processor answers a query the same to the last bit, whatever else is asked with it and by
        however many threads; plain torch, and so any α below MIN_COMPILED_ALPHA, does not.
        """
        centered = np.ascontiguousarray(queries - self._center)
        if self._target is None:
            sums = self._plain.sums(centered, alpha=alpha, contributors=contributors)
        elif not len(queries):
            sums = Sums.empty(min(contributors, self._panels.count))
        elif alpha < MIN_COMPILED_ALPHA:
            from ssil_data.kernels import chunked

            sums = chunked.lcor_sums(
                centered, *self._panels.unpack(), alpha=alpha, contributors=contributors
            )
        else:
            sums = self._compile(
                centered, self._target, min(alpha, MAX_COMPILED_ALPHA), contributors, threads
            )
        return replace(sums, numerator=sums.numerator + self._mean * sums.denominator)

    def _compile(
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
    """Return the sums of equation 5 for queries (m, d) over states (n, d), n ≥ 1, packed for once.

    States and queries are standardized already, below 1e6 or so; leverage is (n,).
    """
    return References(states, leverage).sums(queries, alpha=alpha, contributors=contributors)
