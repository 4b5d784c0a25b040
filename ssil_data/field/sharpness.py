"""The choice of α, the kernel's sharpness, for a store."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ssil_data.kernels import log_kernel

ALPHA_RANGE = (1e-2, 1e4)
"""Where `auto_alpha` searches; beyond the upper end the kernel no longer changes: exp(−d/2)."""
_QUERIES = 64
_REFERENCES = 2048
_BISECTIONS = 16
_MOST_SHIFT = 0.1
"""Part of its share of the store by which an odd α may let a value miss."""


def auto_alpha(standardized: NDArray[np.float32], *, share: float = 0.1, seed: int = 0) -> float:
    """Return the sharpness α at which LCoR rests on `share` of the store on average.

    A larger α makes the kernel sharper: values follow nearby demonstrations more closely, and rest
    on fewer of them. Bisects log α on a sample: 64 states are queries, up to 2,048 others answer.
    The nearest odd α is taken instead where that moves the sample's share by less than a tenth:
    its power is whole, and up to α = 199 LCoR is then quicker by up to a third.

    Parameters
    ----------
    standardized:
        (n, d) the store's states, each dimension with mean 0 and standard deviation 1.
    share:
        The wanted effective sample size as a part of the store, in (0, 1).
    seed:
        Chooses the sample.

    Returns
    -------
    float
        α within `ALPHA_RANGE`; the nearer end where no α is sharp or flat enough.

    Examples
    --------
    >>> from ssil_data.field import auto_alpha
    >>> states = np.random.default_rng(0).normal(size=(500, 30)).astype(np.float32)
    >>> auto_alpha(states, share=0.5) < auto_alpha(states, share=0.2)
    True
    """
    order = np.random.default_rng(seed).permutation(len(standardized))
    queries = standardized[order[:_QUERIES]]
    references = standardized[order[_QUERIES : _QUERIES + _REFERENCES]]
    if not len(references):
        references = queries
    distance = np.stack([np.abs(references - query).sum(axis=1) for query in queries])
    low, high = np.log(ALPHA_RANGE)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        if _effective_share(distance, np.exp(middle)) > share:
            low = middle
        else:
            high = middle
    found = float(np.exp((low + high) / 2))
    odd = 2.0 * round((found - 1) / 2) + 1
    moved = _effective_share(distance, odd) / _effective_share(distance, found) - 1
    return odd if abs(moved) < _MOST_SHIFT else found


def _effective_share(distance: NDArray[np.float32], alpha: float) -> float:
    """Return the mean effective sample size of queries as a part of their references."""
    log_weights = log_kernel(distance, alpha)
    weights = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
    sizes = weights.sum(axis=1) ** 2 / (weights**2).sum(axis=1)
    return float(sizes.mean() / distance.shape[1])
