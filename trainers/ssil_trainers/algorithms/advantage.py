"""Generalized advantage estimation: how much better than expected an action turned out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def compute_advantages(
    rewards: NDArray[np.floating],
    values: NDArray[np.floating],
    next_values: NDArray[np.floating],
    *,
    terminated: NDArray[np.bool_],
    ended: NDArray[np.bool_],
    discount: float,
    gae_lambda: float,
) -> NDArray[np.float64]:
    """Compute GAE(γ, λ): positive where an action did better than the critic expected.

    The temporal-difference error is δ_t = r_t + γ V(s_{t+1}) − V(s_t), and the advantage
    A_t = δ_t + γλ A_{t+1}. After a real end the future is worth 0; at a time limit, and at the end
    of the rollout, it is worth V(s_{t+1}). The sum never crosses from one episode into the next.

    Parameters
    ----------
    rewards:
        Rewards, shape (T, ...): T steps along the first axis.
    values:
        The critic's values of the states in which the steps began, (T, ...).
    next_values:
        Values of the states that the steps led to, (T, ...), also where an episode ended there:
        the last state of the episode, not the first one of the next.
    terminated:
        Where the episode really ended, broadcastable to (T, ...).
    ended:
        Where it ended in any way, by a real end or by a time limit, broadcastable to (T, ...).
    discount:
        γ, from 0 to 1.
    gae_lambda:
        λ, from 0 to 1. With 0 the advantage is δ, the one-step form of the paper's Algorithm 1.

    Returns
    -------
    :
        Advantages, shape (T, ...), in units of the reward.

    Notes
    -----
    Source: Schulman et al., 2016, *High-dimensional continuous control using generalized advantage
    estimation*, equation 16.

    Examples
    --------
    >>> compute_advantages(
    ...     np.array([1.0, 1.0, 1.0]),
    ...     values=np.zeros(3),
    ...     next_values=np.zeros(3),
    ...     terminated=np.array([False, False, True]),
    ...     ended=np.array([False, False, True]),
    ...     discount=0.5,
    ...     gae_lambda=1.0,
    ... )
    array([1.75, 1.5 , 1.  ])
    """
    carry_over = discount * gae_lambda * ~ended
    delta = rewards + discount * next_values * ~terminated - values
    result = np.empty(delta.shape)
    later = np.zeros(delta.shape[1:])
    for t in reversed(range(len(delta))):
        later = delta[t] + carry_over[t] * later
        result[t] = later
    return result
