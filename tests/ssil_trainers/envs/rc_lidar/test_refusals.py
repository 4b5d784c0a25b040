"""What the RC car refuses: cars that cannot drive or start, settings and actions of no form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import ssil_trainers.envs  # noqa: F401  registers the ids
from ssil_data.errors import InvalidInputError
from ssil_trainers.envs.rc_lidar.car import RCCar
from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
from ssil_trainers.envs.rc_lidar.track import Track
from ssil_trainers.envs.rc_lidar.vector_env import RCLidarVectorEnv

STILL = np.zeros(1, dtype=np.float32)


@pytest.mark.parametrize("action", [np.nan, np.inf])
def test_steering_that_is_not_finite_is_refused(action: float) -> None:
    env = RCLidarEnv()
    env.reset(seed=0)
    with pytest.raises(InvalidInputError, match="action: expected finite numbers, found"):
        env.step(np.array([action], dtype=np.float32))


@pytest.mark.parametrize(
    "wrong",
    [
        *({"speed": 0}, {"hz": -1}, {"noise": -0.1}, {"steering_lag": np.nan}),
        *({"substeps": 2.5}, {"substeps": 0.5}, {"substeps": 0}),
        *({"steering_degrees": 90}, {"start_askew_degrees": 181}),
    ],
)
def test_a_car_that_cannot_drive_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError, match=f"^{next(iter(wrong))}: expected"):
        RCCar(**wrong)


@pytest.mark.parametrize(
    "wrong",
    [
        {"width": 1.2},
        {"start_aside": 0.45},
        {"start_aside": 2.0},
        {"overhang": 900.0},
        {"wheelbase": 5},
    ],
)
def test_a_car_that_would_start_in_a_wall_is_refused_with_the_row(wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError, match=r"track hall, row 0: expected room for a car of"):
        RCLidarEnv("hall", car=RCCar(**wrong))


@pytest.mark.parametrize("aside", [0.1, 0.3, 0.36])
def test_starts_are_free_where_the_car_is_let_on_the_track_and_hit_where_it_is_not(
    aside: float,
) -> None:
    """The road is lopsided: 1.1 m wide, but the line runs .35 m from the wall in its first half."""
    angles = 2 * np.pi * np.arange(400) / 400
    left = np.where(angles < np.pi, 0.35, 0.75)
    line = 10 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    track, car = Track("lopsided", line, 1.1 - left, left), RCCar(start_aside=aside, noise=0)
    if aside < 0.35 - car.width / 2:
        states, _ = RCLidarVectorEnv(3_000, track, car=car).reset(seed=0)
        # The nearest wall is beside the car, in the plane of the LiDAR.
        assert 10 * states[:, [0, -2]].min() > car.width / 2
    else:
        with pytest.raises(InvalidInputError, match=r"lopsided, row \d+: expected room"):
            RCLidarEnv(track, car=car)


def test_a_nose_that_would_be_in_a_wall_only_askew_is_refused() -> None:
    RCLidarEnv("hall", car=RCCar(start_aside=0.36, start_askew_degrees=0.1))
    with pytest.raises(InvalidInputError, match=r"hall, row \d+: .* 0\.36 m aside and 5° askew"):
        RCLidarEnv("hall", car=RCCar(start_aside=0.36))


def test_a_car_without_overhang_may_start_half_its_width_aside() -> None:
    RCLidarEnv("hall", car=RCCar(start_aside=0.135, overhang=0.0))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"car": 3}, "car: expected an RCCar, found 3"),
        ({"track": 3}, "track: expected a name, a CSV file or a Track, found 3"),
        ({"episode_steps": 0}, "episode_steps: expected at least 1, found 0"),
        ({"episode_steps": 2.5}, "episode_steps: expected a whole number, found 2.5"),
    ],
)
def test_settings_of_another_kind_are_refused(wrong: dict[str, Any], message: str) -> None:
    for form in (RCLidarEnv, RCLidarVectorEnv):
        with pytest.raises(InvalidInputError, match=f"^{message}$"):
            form(**wrong)


def test_a_step_before_the_first_reset_is_refused() -> None:
    with pytest.raises(ResetNeeded, match=r"\[0\] must be reset first"):
        RCLidarEnv().step(STILL)


def test_options_seeds_and_actions_of_another_form_are_refused() -> None:
    env = RCLidarEnv()
    with pytest.raises(InvalidInputError, match="options: expected none, found 'start'"):
        env.reset(options={"start": None})
    with pytest.raises(InvalidInputError, match="seed: expected at least 0, found -1"):
        env.reset(seed=-1)
    np.testing.assert_array_equal(env.reset(seed=np.int64(3))[0], env.reset(seed=3)[0])
    with pytest.raises(InvalidInputError, match=r"expected shape \(1,\), found \(1, 1\)"):
        env.step(STILL[None])
