"""Forward–backward recursion of a two-state model, vectorized over chunks of the sequence.

With messages as 2-vectors, step t multiplies by M_t = T_t diag(b_t), where T_t is the transition
into t and b_t how likely the observation is in either state. Products over chunks are formed for
all chunks at once, then joined from chunk to chunk: √n steps of array operations instead of n.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def infer(
    log_ratio: NDArray[np.float64], starts: NDArray[np.bool_], *, stay: float, share: float
) -> tuple[NDArray[np.float64], float]:
    """Return the chance that each row is in the first state, given its whole episode.

    A step keeps its state with probability `stay`, else draws one: the first with probability
    `share`, as the first row of an episode does.

    Parameters
    ----------
    log_ratio
        log p(observation | first state) − log p(observation | second), (n,).
    starts
        Marks the first row of each episode, (n,).
    stay, share
        The two probabilities.

    Returns
    -------
    tuple
        The chances (n,), and the share of steps inside episodes that drew a state.
    """
    count = len(log_ratio)
    if not count:
        return np.zeros(0), 0.0
    half = np.clip(log_ratio, -60, 60) / 2
    likely = np.stack([np.exp(half), np.exp(-half)], axis=1)
    prior = np.array([share, 1 - share])
    inside = stay * np.eye(2) + (1 - stay) * prior
    begins = np.broadcast_to(prior, (2, 2))
    step = np.where(starts[:, None, None], begins, inside)
    forward = _scan(step * likely[:, None, :], prior)
    # backward: the message into row t comes from row t + 1, in reverse order of rows
    ahead = np.concatenate([step[1:] * likely[1:, None, :], np.ones((1, 2, 2))])
    backward = _scan(ahead[::-1].transpose(0, 2, 1), np.ones(2))[::-1]
    joint = forward * backward
    chance = joint[:, 0] / joint.sum(axis=1)
    return chance, _count_draws(forward, backward, likely, starts, stay, prior)


def _count_draws(
    forward: NDArray[np.float64],
    backward: NDArray[np.float64],
    likely: NDArray[np.float64],
    starts: NDArray[np.bool_],
    stay: float,
    prior: NDArray[np.float64],
) -> float:
    """Return the expected share of steps inside episodes that drew a new state."""
    rows = np.flatnonzero(~starts)
    if not len(rows):
        return 0.0
    before = forward[rows - 1] / forward[rows - 1].sum(axis=1, keepdims=True)
    after = likely[rows] * backward[rows]
    drawn = (1 - stay) * (after @ prior)
    kept = stay * (before * after).sum(axis=1)
    return float(np.mean(drawn / (drawn + kept)))


def _scan(steps: NDArray[np.float64], first: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return first @ steps[0], first @ steps[0] @ steps[1], …, each scaled to sum 1, (n, 2)."""
    count = len(steps)
    length = max(1, int(np.sqrt(count)))
    chunks = -(-count // length)
    padded = np.concatenate([steps, np.broadcast_to(np.eye(2), (chunks * length - count, 2, 2))])
    grid = padded.reshape(chunks, length, 2, 2)
    product = np.broadcast_to(np.eye(2), (chunks, 2, 2))
    for place in range(length):
        product = product @ grid[:, place]
        product = product / product.sum(axis=(1, 2), keepdims=True)
    entries = np.empty((chunks, 2))
    message = first
    for chunk in range(chunks):
        entries[chunk] = message
        message = message @ product[chunk]
        message = message / message.sum()
    messages = np.empty((chunks, length, 2))
    current = entries
    for place in range(length):
        current = np.einsum("ci,cij->cj", current, grid[:, place])
        current = current / current.sum(axis=1, keepdims=True)
        messages[:, place] = current
    return messages.reshape(-1, 2)[:count]
