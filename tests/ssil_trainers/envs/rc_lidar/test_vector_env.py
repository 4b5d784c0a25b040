"""Many RC cars at once: as gymnasium's own vector environment of single ones, and as each alone."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

import ssil_trainers.envs  # noqa: F401  registers the ids
from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
from ssil_trainers.envs.rc_lidar.vector_env import RCLidarVectorEnv
from support.environment_steps import drive


@pytest.mark.parametrize("steps", [25, 3, 1])
@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_the_fleet_does_what_gymnasium_does_with_single_cars(
    mode: AutoresetMode, steps: int
) -> None:
    """Of 25 steps most end at a wall, of 3 by the time limit, of 1 in all cars at once."""
    shared: dict[str, Any] = {"episode_steps": steps, "track": "yard"}
    fleet = gymnasium.make_vec("RCLidar-v0", num_envs=3, autoreset_mode=mode, **shared)
    single = gymnasium.make_vec(
        "RCLidar-v0",
        num_envs=3,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        **shared,
    )
    assert isinstance(fleet, RCLidarVectorEnv)
    assert fleet.metadata["autoreset_mode"] is mode
    same(fleet.reset(seed=5), single.reset(seed=5))
    rng, ended = np.random.default_rng(0), 0
    for _ in range(100):
        actions = rng.uniform(-0.7, 0.7, (3, 1)).astype(np.float32)
        one, two = fleet.step(actions), single.step(actions)
        same(one, two)
        over = np.logical_or(one[2], one[3])
        ended += over.sum()
        if mode is AutoresetMode.DISABLED and over.any():
            options = [{"reset_mask": over.copy()} for _ in range(2)]
            same(fleet.reset(options=options[0])[0], single.reset(options=options[1])[0])
    assert ended > 6


def same(one: Any, two: Any) -> None:
    """Compare what both forms returned, infos included, bit for bit."""
    if isinstance(one, dict):
        assert one.keys() == two.keys()
        for key in one:
            same(one[key], two[key])
    elif isinstance(one, tuple) or one.dtype == object:
        for a, b in zip(one, two, strict=True):
            assert (a is None) == (b is None)
            if a is not None:
                same(a, b)
    else:
        assert one.dtype == two.dtype
        np.testing.assert_array_equal(one, two)


def test_a_car_does_not_notice_how_many_drive_beside_it() -> None:
    alone = drive(RCLidarEnv("yard"), 7, 120)
    fleet = RCLidarVectorEnv(5, "yard")
    rngs = [np.random.default_rng(4 + car) for car in range(5)]
    states, _ = fleet.reset(seed=4)
    for expected in alone:
        np.testing.assert_array_equal(states[3], expected)
        actions = np.array([rng.uniform(-0.5, 0.5, 1) for rng in rngs], dtype=np.float32)
        states, *_ = fleet.step(actions)


def test_a_fleet_must_be_reset_before_it_is_stepped() -> None:
    fleet, actions = RCLidarVectorEnv(3), np.zeros((3, 1), dtype=np.float32)
    with pytest.raises(ResetNeeded, match=r"\[0 1 2\] must be reset first"):
        fleet.step(actions)
    fleet.reset(options={"reset_mask": np.array([True, False, True])})
    with pytest.raises(ResetNeeded, match=r"\[1\] must be reset first"):
        fleet.step(actions)
    fleet.reset(options={"reset_mask": np.array([False, True, False])})
    fleet.step(actions)


def test_an_ended_car_must_be_reset_where_there_is_no_autoreset() -> None:
    fleet = RCLidarVectorEnv(2, episode_steps=1, autoreset_mode=AutoresetMode.DISABLED)
    fleet.reset(seed=0)
    actions = np.zeros((2, 1), dtype=np.float32)
    fleet.step(actions)
    fleet.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(ResetNeeded, match=r"\[1\] must be reset"):
        fleet.step(actions)


def test_seeds_may_be_numpys_and_one_for_each_car() -> None:
    fleet = RCLidarVectorEnv(2)
    states, _ = fleet.reset(seed=3)
    for seed in (np.int64(3), [3, 4], (3, 4), np.array([3, 4]), [3, np.int32(4)]):
        np.testing.assert_array_equal(fleet.reset(seed=seed)[0], states)


@pytest.mark.parametrize(
    ("seed", "message"),
    [
        ([1], "expected one for each of 2 cars, found 1"),
        ([-3, 1], "expected at least 0, found -3"),
        (-3, "expected at least 0, found -3"),
        ([1.5, 1], "expected a whole number, found 1.5"),
        ("12", "expected a whole number, found '12'"),
    ],
)
def test_invalid_seeds_are_refused(seed: Any, message: str) -> None:
    with pytest.raises(InvalidInputError, match=f"^seed: {message}$"):
        RCLidarVectorEnv(2).reset(seed=seed)


def test_wrong_counts_masks_options_and_actions_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="num_envs: expected at least 1, found 0"):
        RCLidarVectorEnv(0)
    fleet = RCLidarVectorEnv(2)
    for mask in (np.zeros(2, dtype=bool), np.ones(3, dtype=bool), np.ones(2), [True, True]):
        with pytest.raises(InvalidInputError, match="reset_mask: expected 2 booleans"):
            fleet.reset(options={"reset_mask": mask})
    with pytest.raises(InvalidInputError, match="expected reset_mask, found 'start'"):
        fleet.reset(options={"start": None})
    fleet.reset(seed=0)
    for wrong in (np.zeros((1, 2)), np.zeros(2), np.zeros((2, 2))):
        with pytest.raises(InvalidInputError, match=r"expected shape \(2, 1\), found"):
            fleet.step(wrong)
    with pytest.raises(InvalidInputError, match=r"found \[nan\] for car 1"):
        fleet.step(np.array([[0.0], [np.nan]]))


def test_a_refused_reset_changes_nothing() -> None:
    fleet, same = RCLidarVectorEnv(2), RCLidarVectorEnv(2)
    for envs in (fleet, same):
        envs.reset(seed=5)
    with pytest.raises(InvalidInputError):
        fleet.reset(seed=9, options={"reset_mask": np.zeros(2, dtype=bool)})
    np.testing.assert_array_equal(fleet.reset()[0], same.reset()[0])
