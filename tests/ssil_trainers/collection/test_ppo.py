"""Checkpoints of PPO: when they are kept, and how they act."""

from __future__ import annotations

import numpy as np

from ssil_trainers.collection.ppo import PPOSettings, train_ppo
from ssil_trainers.envs.racetrack.env import STATE_NAMES, RacetrackEnv

SMALL = PPOSettings(512, learning_rate=3e-4, environments=2, rollout=128, batch=128, epochs=2)


def test_a_checkpoint_acts_by_the_mean_of_the_policy_that_ppo_had() -> None:
    reported: list[int] = []
    checkpoints = train_ppo(RacetrackEnv, SMALL, run="r", seed=0, progress=reported.append)
    assert [checkpoint.steps for checkpoint in checkpoints] == [0, 256, 512]
    assert reported == [0, 256]
    state = np.linspace(-1, 1, len(STATE_NAMES), dtype=np.float32)
    actions = [checkpoint(state) for checkpoint in checkpoints]
    assert all(np.abs(action).max() <= 1 for action in actions)
    assert (actions[0] != actions[-1]).any()
