"""Generalised advantage estimation: how much better than expected an action turned out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def advantages(
    rewards: NDArray[np.floating],
    values: NDArray[np.floating],
    next_values: NDArray[np.floating],
    *,
    terminated: NDArray[np.bool_],
    ended: NDArray[np.bool_],
    discount: float,
    gae_lambda: float,
) -> NDArray[np.float64]:
    """Return GAE(γ, λ) of T steps along the first axis (Schulman et al., 2016, equation 16).

    δ_t = r_t + γ V(s_{t+1}) − V(s_t), A_t = δ_t + γλ A_{t+1}. `next_values` are of the states that
    the actions led to, also where an episode ended there. A real end (`terminated`) is worth
    nothing afterwards; a time limit, and the end of the rollout, are worth V(s_{t+1}); no `ended`
    episode hears of the next one. All arrays have the shape (T, ...); λ = 0 is δ.
    """
    going_on = discount * gae_lambda * ~ended
    delta = rewards + discount * next_values * ~terminated - values
    result = np.empty(delta.shape)
    later = np.zeros(delta.shape[1:])
    for t in reversed(range(len(delta))):
        later = delta[t] + going_on[t] * later
        result[t] = later
    return result
