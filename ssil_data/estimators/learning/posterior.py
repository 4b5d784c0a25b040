"""Conditioning a Gaussian process on labeled pairs, as features of a state.

Given n labeled pairs (X, y) and m inducing states Z (Titsias, 2009; with Z = X it is exact):

    kernel(Z, Z) = U diag(λ) Uᵀ,  P = U diag(λ)^-½,  G = kernel(X, Z) P,  GᵀG / noise = V diag(γ) Vᵀ
    root = P V diag(γ / (1 + γ))^½,  coefficients = diag(γ (1 + γ))^-½ Vᵀ Gᵀ y / noise
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from ssil_data.estimators.gaussian_process import Kernel, Process
from ssil_data.estimators.learning.descent import reproducible

NEGLIGIBLE = 1e-2
"""Share of the noise variance that the posterior may lose anywhere; on data it loses far less."""

JITTER = 1e-8
"""Share of the signal variance added to λ: states may lie on top of each other."""


def condition(
    kernel: Kernel, inducing: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32]
) -> Process:
    """Condition one action dimension on labeled pairs; in float64, cost m³ + n m².

    Since φᵢ² ≤ signal · γᵢ / (1 + γᵢ), features that together stay below `NEGLIGIBLE` are left out,
    often half of them.

    Parameters
    ----------
    kernel
        The prior covariance and the noise.
    inducing
        Standardized states Z (m, d) to express the posterior in.
    x
        Standardized labeled states X (n, d).
    y
        One standardized action dimension of them (n,).

    Returns
    -------
    Process
        The posterior.
    """
    signal = float(kernel.signal)
    noise = float(kernel.noise)
    some = inducing.astype(np.float64)
    every = x.astype(np.float64)
    with reproducible(seed=0):
        prior, vectors = torch.linalg.eigh(torch.from_numpy(kernel(some, some)))
        p = vectors / (prior.clamp(min=0) + JITTER * signal).sqrt()
        g = torch.from_numpy(kernel(every, some)) @ p
        gain, v = torch.linalg.eigh(g.T @ g / noise)
        kept = signal * (gain / (1 + gain)).cumsum(0) > NEGLIGIBLE * noise
        gain = gain[kept]
        v = v[:, kept]
        root = p @ (v * (gain / (1 + gain)).sqrt())
        pull = v.T @ (g.T @ torch.tensor(y, dtype=torch.float64)) / noise
        coefficients = pull / (gain * (1 + gain)).sqrt()
    return Process(kernel, root.float().numpy(), coefficients.float().numpy())
