"""Tasks by their text: settings reach the environment, and what has no twin is driven singly."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from ssil_data.errors import InvalidInputError, NotFoundError
from ssil_trainers.envs.racetrack.env import RacetrackEnv
from ssil_trainers.envs.racetrack.vector_env import RacetrackVectorEnv
from ssil_trainers.envs.rc_lidar.vector_env import RCLidarVectorEnv
from ssil_trainers.envs.registry import TASKS, find_spec, make_single, make_vectorized


def test_traffic_is_driven_in_real_environments_side_by_side() -> None:
    envs = make_vectorized("racetrack?other_vehicles=3&episode_steps=4", 2)
    assert isinstance(envs, SyncVectorEnv)
    assert all(isinstance(env.unwrapped, RacetrackEnv) for env in envs.envs)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    envs.reset(seed=0)
    for step in range(1, 9):
        actions = np.zeros((2, 2), dtype=np.float32)
        states, _, _, truncated, info = envs.step(actions)
        assert envs.observation_space.contains(states)
        assert truncated.all() == (step % 4 == 0) == ("final_obs" in info)
    envs.close()


def test_without_traffic_the_twins_drive() -> None:
    for task, twin in (
        ("racetrack", RacetrackVectorEnv),
        ("racetrack?other_vehicles=0", RacetrackVectorEnv),
        ("rc-lidar?track=yard", RCLidarVectorEnv),
    ):
        envs = make_vectorized(task, 2)
        assert isinstance(envs, twin)
        assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ("rc-lidar?car=3", "car: expected an RCCar, found 3"),
        ("rc-lidar?track=3", "track: expected a name, a CSV file or a Track, found 3"),
        ("rc-lidar?episode_steps=2.5", "episode_steps: expected a whole number, found 2.5"),
        ("racetrack?episode_steps=0", "episode_steps: expected at least 1, found 0"),
        ("racetrack?policy_hz=2.5", "policy_hz: expected a whole number, found 2.5"),
        ("racetrack?policy_hz=1_0", "policy_hz: expected a whole number, found '1_0'"),
        ("racetrack?other_vehicles=-1", "other_vehicles: expected at least 0, found -1"),
    ],
)
def test_settings_that_make_no_environment_are_refused_in_either_form(
    task: str, message: str
) -> None:
    for make in (make_single, lambda text: make_vectorized(text, 2)):
        with pytest.raises(InvalidInputError, match=f"^{message}$"):
            make(task)


def test_a_text_with_an_underscore_is_no_number() -> None:
    assert find_spec("rc-lidar?track=1_0").kwargs == {"track": "1_0"}
    assert find_spec("rc-lidar?episode_steps=10").kwargs == {"episode_steps": 10}


def test_unknown_environments_are_refused_by_name() -> None:
    with pytest.raises(NotFoundError, match=r"racetrack.*found 'racetrakc'"):
        find_spec("racetrakc")


def test_a_task_takes_the_environments_settings() -> None:
    assert find_spec("racetrack?policy_hz=5&track=oval").kwargs == {"policy_hz": 5, "track": "oval"}
    assert find_spec("racetrack").kwargs == {}
    assert find_spec("Pendulum-v1?g=9.81").kwargs == {"g": 9.81}
    for task, message in (("racetrack?fast", "key=value"), ("racetrack?wings=2", "wings")):
        with pytest.raises(InvalidInputError, match=message):
            make_vectorized(task, 1)
    with pytest.raises(InvalidInputError, match="wings"):
        make_single("Pendulum-v1?wings=2")


@pytest.mark.parametrize("task", TASKS)
def test_the_projects_tasks_can_be_driven_alone_and_side_by_side(task: str) -> None:
    envs, env = make_vectorized(task, 2), make_single(task)
    assert envs.single_observation_space == env.observation_space
    assert envs.single_action_space == env.action_space
    assert envs.metadata["autoreset_mode"].value == "SameStep"
