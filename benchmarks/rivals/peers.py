"""LCoR as one would write it with other libraries, one thread, float32 where they allow it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
import torch

Peer = Callable[[np.ndarray, np.ndarray, np.ndarray, float], np.ndarray]


def torch_cdist(queries: np.ndarray, states: np.ndarray, leverage: np.ndarray, alpha: float) -> Any:
    """torch.cdist and pow."""
    distance = torch.cdist(torch.from_numpy(queries), torch.from_numpy(states), p=1.0)
    kernel = (1 + distance / alpha).pow(-(alpha + 1) / 2)
    return ((kernel @ torch.from_numpy(leverage)) / kernel.sum(1)).numpy()


def torch_broadcast(
    queries: np.ndarray, states: np.ndarray, leverage: np.ndarray, alpha: float
) -> Any:
    """Torch broadcasting, four queries at a time."""
    values = []
    reference = torch.from_numpy(states)
    for query in torch.from_numpy(queries).split(4):
        distance = (query[:, None] - reference).abs().sum(2)
        kernel = (1 + distance / alpha).pow(-(alpha + 1) / 2)
        values.append((kernel @ torch.from_numpy(leverage)) / kernel.sum(1))
    return torch.cat(values).numpy()


def _average(distance: np.ndarray, leverage: np.ndarray, alpha: float) -> np.ndarray:
    """Return the mean of the leverages, weighted by the kernel of distances (m, n)."""
    kernel = (1 + distance / alpha) ** (-(alpha + 1) / 2)
    return kernel @ leverage / kernel.sum(axis=1)


def scipy_cdist(queries: np.ndarray, states: np.ndarray, leverage: np.ndarray, alpha: float) -> Any:
    """Scipy's cdist, in float64, as it has no other."""
    from scipy.spatial.distance import cdist

    return _average(cdist(queries, states, "cityblock"), leverage, alpha)


def sklearn(queries: np.ndarray, states: np.ndarray, leverage: np.ndarray, alpha: float) -> Any:
    """scikit-learn's manhattan_distances."""
    from sklearn.metrics.pairwise import manhattan_distances

    return _average(manhattan_distances(queries, states), leverage, alpha)


def faiss(queries: np.ndarray, states: np.ndarray, leverage: np.ndarray, alpha: float) -> Any:
    """FAISS's pairwise L1 distances."""
    import faiss as library  # pyright: ignore[reportMissingImports]

    distance = library.pairwise_distances(queries, states, metric=library.METRIC_L1)
    return _average(distance, leverage, alpha)


def keops(queries: np.ndarray, states: np.ndarray, leverage: np.ndarray, alpha: float) -> Any:
    """KeOps, symbolic and compiled."""
    from pykeops.numpy import LazyTensor  # pyright: ignore[reportMissingImports]

    distance = (LazyTensor(queries[:, None]) - LazyTensor(states[None])).abs().sum(-1)
    kernel = (1 + distance / alpha) ** (-(alpha + 1) / 2)
    values = kernel @ np.stack([leverage, np.ones_like(leverage)], axis=1)
    return values[:, 0] / values[:, 1]


@cache
def _jax() -> Any:
    import jax  # pyright: ignore[reportMissingImports]
    import jax.numpy as jnp  # pyright: ignore[reportMissingImports]

    @jax.jit
    def lcor(queries: Any, states: Any, leverage: Any, alpha: float) -> Any:
        def one(query: Any) -> Any:
            kernel = (1 + jnp.abs(query - states).sum(1) / alpha) ** (-(alpha + 1) / 2)
            return kernel @ leverage / kernel.sum()

        return jax.lax.map(one, queries)

    return lcor


def jax(queries: np.ndarray, states: np.ndarray, leverage: np.ndarray, alpha: float) -> Any:
    """JAX, compiled, one query after the other."""
    return np.asarray(_jax()(queries, states, leverage, alpha))


@cache
def _numba() -> Any:
    import numba  # pyright: ignore[reportMissingImports]

    @numba.njit(fastmath=True)
    def lcor(queries: Any, states: Any, leverage: Any, alpha: Any, power: Any) -> Any:
        values = np.empty(len(queries), np.float32)
        for m in range(len(queries)):
            numerator = np.float32(0)
            denominator = np.float32(0)
            for n in range(len(states)):
                distance = np.float32(0)
                for i in range(states.shape[1]):
                    distance += abs(queries[m, i] - states[n, i])
                kernel = (np.float32(1) + distance / alpha) ** power
                numerator += kernel * leverage[n]
                denominator += kernel
            values[m] = numerator / denominator
        return values

    return lcor


def numba(queries: np.ndarray, states: np.ndarray, leverage: np.ndarray, alpha: float) -> Any:
    """A plain loop in numba."""
    return _numba()(queries, states, leverage, np.float32(alpha), np.float32(-(alpha + 1) / 2))


_ALL: dict[str, tuple[str, Peer]] = {
    "torch.cdist + pow": ("torch", torch_cdist),
    "torch broadcasting": ("torch", torch_broadcast),
    "scipy": ("scipy", scipy_cdist),
    "scikit-learn": ("sklearn", sklearn),
    "numba loop": ("numba", numba),
    "KeOps": ("pykeops", keops),
    "JAX": ("jax", jax),
    "FAISS": ("faiss", faiss),
}


def find_peers() -> dict[str, Peer]:
    """Return the peers whose library is installed, by name."""
    return {name: peer for name, (module, peer) in _ALL.items() if find_spec(module)}
