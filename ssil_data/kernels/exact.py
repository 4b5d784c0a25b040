"""LCoR's exact sums of some queries over all packed references, rescaled so that none is lost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels.formulas import log_kernel
from ssil_data.kernels.panels import Panels
from ssil_data.kernels.passes import Pass
from ssil_data.kernels.sums import Sums

_MAX_LOG_WEIGHT = 24 * np.log(2)
"""Log of the largest weight beyond which, either way, float32 loses the smaller weights."""
_MIN_LOG_T = -3.0
"""Log of the nearest reference's t below which 1 + u has lost too many bits of t."""


def exact_sums(work: Pass, queries: NDArray[np.float32], *, contributors: int) -> Sums:
    """Return the sums over all references.

    Weights are first taken relative to the kernel at a query's distance to the center. Where that
    is out of the range of float32 (large α, far from the data) or too coarse (small α, close to a
    reference), they are taken again, relative to the nearest reference, which is known by then.

    Parameters
    ----------
    work
        The pass over the references, of the products `SUMS`.
    queries
        Centered queries (m, d), m ≥ 1.
    contributors
        How many of the heaviest references to name; no more than there are.
    """
    to_center = np.abs(queries.astype(np.float64)).sum(axis=1)
    sums, brackets = work(queries, to_center)
    nearest = work.distance(queries, brackets.min(axis=1))
    log_scale = log_kernel(nearest, work.alpha)
    log_weight = log_scale - log_kernel(to_center, work.alpha)
    lost = np.abs(log_weight) > _MAX_LOG_WEIGHT
    if work.code.power.offset == 0:
        log_t = np.log1p(nearest / work.alpha) - np.log1p(to_center / work.alpha)
        lost |= log_t < _MIN_LOG_T
    if lost.any():
        sums[:, lost], _ = work(queries[lost], nearest[lost])
        log_weight[lost] = 0
    numerator, denominator, squares = sums * np.exp(-log_weight * [[1], [1], [2]])
    rows, distances = _find_nearest(
        queries, brackets, work.panels, min(contributors, work.panels.count)
    )
    weights = np.exp(log_kernel(distances, work.alpha) - log_scale[:, None])
    return Sums(numerator, denominator, squares, log_scale, rows, weights)


def _find_nearest(
    queries: NDArray[np.float32], brackets: NDArray[np.float32], panels: Panels, count: int
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return rows and distances, (m, count) each, of the nearest references, nearest first.

    They lie in the `count` panels whose smallest brackets are least.
    """
    rows = np.empty((len(queries), count), np.int64)
    distances = np.empty((len(queries), count), np.float32)
    last = min(count, len(panels.values)) - 1
    for i in range(len(queries)) if count else ():
        chosen = np.argpartition(brackets[i], last)[: last + 1]
        rows[i], distances[i] = panels.nearest(queries[i], chosen, count)
    return rows, distances
