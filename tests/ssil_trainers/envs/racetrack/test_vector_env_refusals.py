"""What the racetrack refuses in both forms: starts, settings, options, actions, early steps."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

import ssil_trainers.envs  # noqa: F401  registers the id
from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.racetrack.env import HIGHWAY_IDS, RacetrackEnv, TrackName
from ssil_trainers.envs.racetrack.starts import Start
from ssil_trainers.envs.racetrack.vector_env import RacetrackVectorEnv


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (Start(18, 0.0, 10.0), "lane from 0 to 17"),
        (Start(0, 58.1, 10.0), "0 to 58 m along it"),
        (Start(0, float("nan"), 10.0), "0 to 58 m along it"),
        (Start(0, 1.0, 20.5), "speed from 0 to 20 m/s"),
    ],
)
def test_starts_off_the_road_are_refused(start: Start, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        RacetrackEnv().reset(options={"start": start})
    with pytest.raises(InvalidInputError, match=message):
        RacetrackVectorEnv(1).reset(options={"start": [start]})


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (Start(0, 1.0, 5.0), r"start: expected one for each of 2 cars, found Start\("),
        ([None, None], "start: expected a Start, found None"),
        ([Start(0, 1.0, 5.0), (0, 1.0, 5.0)], r"start: expected a Start, found \(0, 1.0, 5.0\)"),
        ([Start(1.5, 1.0, 5.0)] * 2, "start: expected a lane by its row, found"),
        ([Start(0, 99.0, 5.0)] * 2, "0 to 58 m along it"),
    ],
)
def test_starts_of_another_form_are_refused_and_nothing_is_reseeded(
    start: Any, message: str
) -> None:
    envs, same = RacetrackVectorEnv(2), RacetrackVectorEnv(2)
    for one in (envs, same):
        one.reset(seed=4)
    with pytest.raises(InvalidInputError, match=message):
        envs.reset(seed=9, options={"start": start})
    assert envs.np_random_seed == (4, 5)
    np.testing.assert_array_equal(envs.reset()[0], same.reset()[0])


def test_only_starts_of_the_cars_that_are_reset_are_checked() -> None:
    envs, start = RacetrackVectorEnv(2), Start(3, 1.0, 5.0)
    envs.reset(seed=0)
    mask = np.array([False, True])
    envs.reset(options={"start": [None, start], "reset_mask": mask})
    assert envs.starts[1] == start


def test_a_refused_start_reseeds_no_real_environment_either() -> None:
    real, same = RacetrackEnv(), RacetrackEnv()
    for one in (real, same):
        one.reset(seed=4)
    for start in (Start(18, 0.0, 10.0), [Start(0, 0.0, 10.0)]):
        with pytest.raises(InvalidInputError, match="start: expected a"):
            real.reset(seed=9, options={"start": start})
    np.testing.assert_array_equal(real.reset()[0], same.reset()[0])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"num_envs": 0}, "num_envs: expected at least 1, found 0"),
        ({"other_vehicles": 2}, "other_vehicles: expected 0 in the vector environment, found 2"),
        ({"render_mode": "rgb_array"}, "render_mode: expected None in the vector environment"),
        ({"track": "moon"}, "track: expected one of default, large, oval, found 'moon'"),
        ({"policy_hz": 15}, "policy_hz: expected a divisor of the simulation's 20 Hz, found 15"),
        ({"policy_hz": 2.5}, "policy_hz: expected a whole number, found 2.5"),
        ({"policy_hz": 2}, "policy_hz: expected at least 4, found 2"),
        ({"policy_hz": 0}, "policy_hz: .* found 0"),
        ({"episode_steps": 0}, "episode_steps: expected at least 1, found 0"),
        ({"episode_steps": -5}, "episode_steps: expected at least 1, found -5"),
        ({"episode_steps": 2.5}, "episode_steps: expected a whole number, found 2.5"),
    ],
)
def test_what_cannot_be_driven_is_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        RacetrackVectorEnv(**settings)
    if settings.keys() & {"track", "policy_hz", "episode_steps"}:
        with pytest.raises(InvalidInputError, match=message):
            RacetrackEnv(**settings)


@pytest.mark.parametrize("track", HIGHWAY_IDS)
def test_at_the_slowest_rate_the_car_leaves_the_road_but_not_the_observation_space(
    track: TrackName,
) -> None:
    twin = RacetrackVectorEnv(500, track, policy_hz=4, autoreset_mode="SameStep")
    rng, lanes = np.random.default_rng(0), twin.road.lanes.length
    rows = rng.integers(len(lanes), size=500)
    starts = [Start(int(row), float(rng.uniform(0, lanes[row])), 20.0) for row in rows]
    twin.reset(seed=0, options={"start": starts})
    held = rng.choice([-1, -0.4, -0.2, 0, 0.2, 0.4, 1], size=500)
    farthest = 0.0
    for _ in range(10):
        *_, info = twin.step(np.stack([np.ones(500), held], axis=1).astype(np.float32))
        for state in info.get("final_obs", []):
            if state is not None:
                assert twin.single_observation_space.contains(state)
                farthest = max(farthest, abs(state[20]))
    assert farthest > 1.5


def test_a_step_before_the_first_reset_is_refused() -> None:
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"\[0 1\] must be reset first"):
        RacetrackVectorEnv(2).step(np.zeros((2, 2), dtype=np.float32))


def test_a_step_of_the_real_environment_before_its_first_reset_is_refused() -> None:
    with pytest.raises(gymnasium.error.ResetNeeded, match="must be reset first"):
        RacetrackEnv().step(np.zeros(2, dtype=np.float32))


def test_unknown_options_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="expected start or reset_mask, found 'starts'"):
        RacetrackVectorEnv(1).reset(options={"starts": []})
    with pytest.raises(InvalidInputError, match="options: expected start, found 'reset_mask'"):
        RacetrackEnv().reset(options={"reset_mask": np.ones(1, dtype=bool)})


def test_bad_actions_seeds_and_masks_are_refused() -> None:
    envs = RacetrackVectorEnv(3)
    envs.reset(seed=0)
    actions = np.zeros((3, 2), dtype=np.float32)
    with pytest.raises(InvalidInputError, match=r"expected shape \(3, 2\), found \(2,\)"):
        envs.step(actions[0])
    actions[1, 0] = np.nan
    with pytest.raises(InvalidInputError, match=r"found \[nan  0.\] for car 1"):
        envs.step(actions)
    with pytest.raises(InvalidInputError, match="one for each of 3 cars, found 2"):
        envs.reset(seed=[1, 2])
    with pytest.raises(InvalidInputError, match="one for each of 3 cars, found 1"):
        envs.reset(options={"start": [Start(0, 0.0, 5.0)]})
    for seed in (-1, [-1, 1, 2], 1.5):
        with pytest.raises(InvalidInputError, match="seed: expected"):
            envs.reset(seed=seed)
    for mask in (np.zeros(3, dtype=bool), np.ones(2, dtype=bool), [True, True, True]):
        with pytest.raises(InvalidInputError, match="reset_mask: expected"):
            envs.reset(options={"reset_mask": mask})
