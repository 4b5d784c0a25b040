"""Recorded steps of the RC car that several tests look at."""

from __future__ import annotations

import numpy as np

from ssil_trainers.envs.rc_lidar.env import RCLidarEnv


def drive(env: RCLidarEnv, seed: int, steps: int) -> list[np.ndarray]:
    """Return the states of so many seeded random steps, whatever the number of episodes."""
    rng = np.random.default_rng(seed)
    states = []
    state, _ = env.reset(seed=seed)
    over = False
    for _ in range(steps):
        action = rng.uniform(-0.5, 0.5, 1).astype(np.float32)
        states.append(state)
        if over:
            state, _ = env.reset()
            over = False
        else:
            state, _, terminated, truncated, _ = env.step(action)
            over = terminated or truncated
    return states
