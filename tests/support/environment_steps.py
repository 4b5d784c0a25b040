"""Drives of the RC car that several tests look at."""

from __future__ import annotations

import numpy as np

from ssil_trainers.envs.rc_lidar.env import RCLidarEnv


def drive(env: RCLidarEnv, seed: int, steps: int) -> list[np.ndarray]:
    """States of a drive with seeded random steering, through as many episodes as it takes."""
    rng, states = np.random.default_rng(seed), []
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
