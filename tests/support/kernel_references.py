"""Random references, LCoR's sums over them by a loop, and the targets that a host can run."""

from __future__ import annotations

import platform

import llvmlite.binding as llvm
import numpy as np

from ssil_data.kernels import log_kernel
from ssil_data.kernels.inner_loop import Tile
from ssil_data.kernels.native import AVX2, AVX512, GENERIC, NEON, Target

ALPHAS = (1e-4, 0.01, 0.3, 1.0, 2.0, 3.0, 7.5, 11.0, 100.0, 199.0, 1e4, 1e9)


def targets() -> list[Target | None]:
    """Return every target that this host can run, the fallback (None) among them."""
    host = Target.host()
    known: list[Target | None] = [None, GENERIC]
    if host is None:
        return known
    # the shapes of other processors' tiles run on any
    known += [Target(NEON, host.processor, host.features)]
    known += [Target(Tile(lanes=2, vectors=1, queries=3), host.processor, host.features)]
    if platform.machine() in ("x86_64", "AMD64"):
        features = llvm.get_host_cpu_features()
        if features.get("avx2") and features.get("fma"):
            known += [Target(AVX2, "x86-64-v3", "")]
        if features.get("avx512f"):
            known += [Target(AVX512, "x86-64-v4", "-prefer-256-bit")]
    return [*known, host, host.for_one_query()]


def name_of(target: Target | None) -> str:
    """Return a test id."""
    if target is None:
        return "torch"
    tile = target.tile
    return f"{tile.lanes}x{tile.vectors}x{tile.queries}-{target.processor or 'generic'}"


def draw_references(seed: int, count: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return standard normal states and uniform leverages."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, width)).astype(np.float32), rng.random(count, np.float32)


def slow_lcor(
    queries: np.ndarray, states: np.ndarray, leverage: np.ndarray, alpha: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return LCoR and effective sample sizes in float64, one query after the other."""
    values, sizes = [], []
    for query in queries.astype(np.float64):
        log_weights = log_kernel(np.abs(states.astype(np.float64) - query).sum(axis=1), alpha)
        weights = np.exp(log_weights - log_weights.max())
        values.append((weights * leverage.astype(np.float64)).sum() / weights.sum())
        sizes.append(weights.sum() ** 2 / (weights**2).sum())
    return np.array(values), np.array(sizes)
