"""The twin in stable-baselines3: what it trains on is what single real environments would give."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.racetrack.env import RacetrackEnv
from ssil_trainers.envs.racetrack.vector_env import RacetrackVectorEnv
from ssil_trainers.envs.sb3_vec_env import StableBaselinesVecEnv

CARS = 5


def pair(episode_steps: int) -> tuple[Any, Any]:
    single = DummyVecEnv([lambda: RacetrackEnv(episode_steps=episode_steps)] * CARS)
    twin = RacetrackVectorEnv(
        CARS, episode_steps=episode_steps, autoreset_mode=AutoresetMode.SAME_STEP
    )
    return single, StableBaselinesVecEnv(twin)


def test_steps_and_infos_are_those_of_single_environments() -> None:
    single, twin = pair(episode_steps=6)
    rng = np.random.default_rng(0)
    for envs in (single, twin):
        envs.seed(4)
    np.testing.assert_allclose(single.reset(), twin.reset(), rtol=0, atol=1e-6)
    for _ in range(25):
        actions = rng.uniform(-1, 1, size=(CARS, 2)).astype(np.float32)
        states, rewards, ended, infos = single.step(actions)
        twin_states, twin_rewards, twin_ended, twin_infos = twin.step(actions)
        np.testing.assert_allclose(states, twin_states, rtol=0, atol=1e-6)
        np.testing.assert_allclose(rewards, twin_rewards, rtol=1e-6)
        assert rewards.dtype == twin_rewards.dtype
        np.testing.assert_array_equal(ended, twin_ended)
        for one, other in zip(infos, twin_infos, strict=True):
            assert one.keys() == other.keys()
            for key in one:
                np.testing.assert_allclose(one[key], other[key], rtol=1e-6, atol=1e-6)
        for one, other in zip(single.reset_infos, twin.reset_infos, strict=True):
            np.testing.assert_allclose(one["position"], other["position"])


def test_a_car_that_leaves_the_road_in_its_last_step_was_not_cut_off() -> None:
    full_lock = np.ones((CARS, 2), dtype=np.float32)
    long, _ = pair(episode_steps=500)
    long.seed(4)
    long.reset()
    steps, ended = 0, np.zeros(CARS, dtype=bool)
    while not ended.any():
        _, _, ended, _ = long.step(full_lock)
        steps += 1
    both = pair(episode_steps=steps)
    for envs in both:
        envs.seed(4)
        envs.reset()
        for _ in range(steps - 1):
            envs.step(full_lock)
        _, _, last, infos = envs.step(full_lock)
        assert last.all()
        assert [info["TimeLimit.truncated"] for info in infos] == (~ended).tolist()
    assert not ended.all()


def test_ppo_learns_the_same_policy_on_either() -> None:
    policies = []
    for envs in pair(episode_steps=200):
        learner = PPO(
            "MlpPolicy",
            VecNormalize(VecMonitor(envs), norm_obs=False),
            n_steps=64,
            batch_size=64,
            n_epochs=2,
            seed=1,
            device="cpu",
        )
        learner.learn(640)
        policies.append(learner.policy.state_dict())
    for name, weights in policies[0].items():
        assert torch.allclose(weights, policies[1][name], atol=1e-6), name


def test_environments_that_lose_a_step_on_a_reset_are_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"expected autoreset_mode SAME_STEP, found .*NEXT"):
        StableBaselinesVecEnv(gymnasium.make_vec("SSILRacetrack-v0", num_envs=2))


def test_what_only_single_environments_can_do_is_refused() -> None:
    _, twin = pair(episode_steps=5)
    assert twin.get_attr("num_envs") == [CARS] * CARS
    assert twin.env_is_wrapped(gymnasium.Wrapper) == [False] * CARS
    with pytest.raises(NotImplementedError, match="some of"):
        twin.set_attr("num_envs", 3)
    with pytest.raises(NotImplementedError, match="some of"):
        twin.env_method("reset")
    twin.set_options({"start": None})
    with pytest.raises(InvalidInputError, match="options: expected none"):
        twin.reset()
    twin.close()
