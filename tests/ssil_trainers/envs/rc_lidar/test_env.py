"""The RC car: its interfaces, its randomness, its dynamics by an independent reference."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_for_stable_baselines3
from stable_baselines3.common.env_util import make_vec_env

import ssil_trainers.envs  # noqa: F401  registers the ids
from ssil_data.errors import InvalidInputError
from ssil_trainers.collection.pure_pursuit import PurePursuit
from ssil_trainers.collection.recording import record
from ssil_trainers.envs.rc_lidar.car import RCCar
from ssil_trainers.envs.rc_lidar.env import STATE_NAMES, RCLidarEnv
from ssil_trainers.envs.rc_lidar.rendering import color_for, draw_drive
from ssil_trainers.envs.rc_lidar.track import save_track
from ssil_trainers.envs.rc_lidar.tracks import NAMED, find_track
from ssil_trainers.envs.rc_lidar.vector_env import RCLidarVectorEnv
from support.environment_steps import drive

STILL = np.zeros(1, dtype=np.float32)


def test_gymnasium_and_stable_baselines3_accept_it() -> None:
    env = gymnasium.make("RCLidar-v0", render_mode="rgb_array").unwrapped
    check_env(env)
    check_for_stable_baselines3(env)


def test_same_seed_same_drive_and_another_seed_another() -> None:
    env = RCLidarEnv()
    first, again, other = drive(env, 1, 60), drive(env, 1, 60), drive(env, 2, 60)
    np.testing.assert_array_equal(first, again)
    assert (first[0] != other[0]).any()


def test_without_a_seed_episodes_and_cars_differ() -> None:
    env = RCLidarEnv()
    starts = [env.reset(seed=0)[0], env.reset()[0], env.reset()[0]]
    assert not any(np.array_equal(a, b) for i, a in enumerate(starts) for b in starts[:i])
    states, _ = RCLidarVectorEnv(4).reset()
    assert len(np.unique(states, axis=0)) == 4


def test_the_car_moves_as_a_finely_integrated_bicycle_with_lagging_wheels() -> None:
    env = RCLidarEnv("yard")
    env.reset(seed=0)
    x, y, heading = env.pose
    wheels, tick, car = 0.0, 1e-5, env.car
    for action in (0.3, -0.4, 0.2):
        env.step(np.array([action], dtype=np.float32))
        for _ in range(round(0.1 / tick)):
            wheels += (action * np.deg2rad(car.steering_degrees) - wheels) / car.steering_lag * tick
            x += car.speed * np.cos(heading) * tick
            y += car.speed * np.sin(heading) * tick
            heading += car.speed / car.wheelbase * np.tan(wheels) * tick
    moved = np.array([x, y, np.angle(np.exp(1j * heading))])
    # The wheels are read at the end of every 20 ms, so the path is right to first order.
    np.testing.assert_allclose(env.pose, moved, atol=0.05)
    np.testing.assert_allclose(fine_pose(), moved, atol=2e-3)


def fine_pose() -> np.ndarray:
    env = RCLidarEnv("yard", car=RCCar(substeps=500))
    env.reset(seed=0)
    for action in (0.3, -0.4, 0.2):
        env.step(np.array([action], dtype=np.float32))
    return env.pose


def test_beams_are_the_walls_ranges_with_noise_of_the_named_size() -> None:
    car = RCCar(noise=0.02)
    fleet = RCLidarVectorEnv(2_000, "yard", car=car)
    states, _ = fleet.reset(seed=0)
    clear, _ = RCLidarVectorEnv(2_000, "yard", car=replace(car, noise=0.0)).reset(seed=0)
    hit = (clear[:, :-1] < 1) & (clear[:, :-1] > 0) & (states[:, :-1] < 1)
    error = states[:, :-1][hit] / clear[:, :-1][hit] - 1
    assert error.mean() == pytest.approx(0, abs=1e-3)
    assert error.std() == pytest.approx(0.02, rel=0.02)
    beams = (states[:, 0] / clear[:, 0] - 1, states[:, 1] / clear[:, 1] - 1)
    assert np.corrcoef(*beams)[0, 1] == pytest.approx(0, abs=0.08)
    assert (clear[clear[:, 9] == 1][:, 9] == states[clear[:, 9] == 1][:, 9]).all()


def test_the_lidar_sees_what_rays_from_its_place_meet() -> None:
    env = RCLidarEnv("hall", car=RCCar(noise=0.0))
    for seed in range(5):
        state, _ = env.reset(seed=seed)
        x, y, heading = env.pose
        place = [x + 0.275 * np.cos(heading), y + 0.275 * np.sin(heading), heading]
        ranges = env.track.walls.scan(place, np.deg2rad(np.arange(-90, 91, 10)), reach=10)[0]
        np.testing.assert_allclose(state[:-1], ranges / 10, atol=1e-6)


def test_starts_are_spread_over_the_lap_and_near_the_line() -> None:
    fleet = RCLidarVectorEnv(3_000, "yard")
    _, infos = fleet.reset(seed=0)
    line = fleet.track.sample_poses(0.05)[:, :2]
    gaps = np.linalg.norm(infos["position"][:, None] - line[None, ::8], axis=2)
    assert gaps.min(axis=1).max() <= np.hypot(0.1, 0.2) + 0.01
    counts = np.histogram(gaps.argmin(axis=1), bins=16)[0]
    assert counts.min() > 120


def test_the_previous_steering_is_in_the_state_and_clipped() -> None:
    env = RCLidarEnv("yard")
    state, _ = env.reset(seed=0)
    assert state[-1] == 0
    assert env.step(np.array([-0.25], dtype=np.float32))[0][-1] == pytest.approx(-0.25)
    assert env.step(np.array([9.0], dtype=np.float32))[0][-1] == 1


@pytest.mark.parametrize("track", NAMED)
def test_a_lap_is_400_steps_and_the_expert_survives_it(track: str) -> None:
    env = RCLidarEnv(track)
    assert env.episode_steps == 400
    lap = record(env, PurePursuit(env, ahead=1.4), seed=0)
    assert (len(lap), lap.total_reward, lap.ending) == (400, 400.0, "truncated")
    gone = np.linalg.norm(lap.positions[-1] - lap.positions[0])
    assert gone < 2.0, "one lap ends where it began"


def test_a_car_that_does_not_steer_ends_at_a_wall_without_reward() -> None:
    env = RCLidarEnv("hall")
    env.reset(seed=0)
    rewards, over = [], False
    while not over:
        _, reward, over, truncated, info = env.step(STILL)
        rewards.append(reward)
        assert info["underlying_reward"] == reward
        assert not truncated
    assert rewards == [1.0] * (len(rewards) - 1) + [0.0]


def test_a_collision_is_the_first_touch_of_the_rectangle_and_a_wall() -> None:
    """Before the hit no corner of the car is beyond a wall; one step later one of them would be."""
    env = RCLidarEnv("hall", car=RCCar(substeps=50))
    for seed in range(6):
        env.reset(seed=seed)
        over = False
        while not over:
            inside = corners_inside(env)
            assert inside, "still driving, so still inside"
            over = env.step(STILL)[2]
        assert not corners_inside(env)


def corners_inside(env: RCLidarEnv) -> bool:
    """Ray casting in the other direction: every corner can be seen from the rear axle."""
    x, y, heading = env.pose
    for ahead, aside in ((-0.09, -0.135), (-0.09, 0.135), (0.42, -0.135), (0.42, 0.135)):
        far, angle = np.hypot(ahead, aside), np.arctan2(aside, ahead)
        if env.track.walls.scan([x, y, heading], [angle], reach=far).item() < far:
            return False
    return True


@pytest.mark.parametrize("form", [RCLidarEnv, RCLidarVectorEnv])
def test_pictures_come_as_fast_as_decisions(form: Any) -> None:
    assert form(car=RCCar(hz=20)).metadata["render_fps"] == 20
    assert form().metadata["render_fps"] == form.metadata["render_fps"] == 10


def test_a_track_is_given_by_its_name_its_file_or_as_a_track(tmp_path: Path) -> None:
    track = find_track("hall")
    save_track(track, tmp_path / "mine.csv")
    for given in (track, "hall", tmp_path / "mine.csv", str(tmp_path / "mine.csv")):
        np.testing.assert_array_equal(RCLidarEnv(given).track.center, track.center)


def test_pictures_show_the_car_and_move_with_it() -> None:
    env = RCLidarEnv(render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    env.step(STILL)
    second = env.render()
    assert first.shape == second.shape == (480, 720, 3)
    assert first.dtype == np.uint8
    assert (first != second).any()
    assert RCLidarEnv().render() is None
    fleet = RCLidarVectorEnv(2, render_mode="rgb_array")
    fleet.reset(seed=0)
    np.testing.assert_array_equal(fleet.render()[0], first)


def test_a_drive_is_painted_in_the_colors_of_its_values() -> None:
    track = find_track("yard")
    path = track.sample_poses(0.4)[:, :2]
    for value in (0.0, 1.0):
        image = np.asarray(draw_drive(track, path, np.full(len(path), value)))
        painted = (image == color_for(value)).all(axis=2).sum()
        other = (image == color_for(1 - value)).all(axis=2).sum()
        assert painted > 1_000 > other
    with pytest.raises(InvalidInputError, match=r"one for each position, found \(3,\)"):
        draw_drive(track, path, np.zeros(3))


def test_the_state_has_the_papers_twenty_numbers() -> None:
    assert len(STATE_NAMES) == 20
    space = RCLidarEnv().observation_space
    assert space.shape == (20,)


@pytest.mark.slow
def test_ppo_of_stable_baselines3_learns_it_out_of_the_box() -> None:
    envs = make_vec_env("RCLidar-v0", n_envs=8, seed=0)
    learner = PPO("MlpPolicy", envs, n_steps=128, batch_size=256, seed=0, device="cpu")
    before = survived(learner)
    learner.learn(60_000)
    assert before < 0.2
    assert survived(learner) > 0.6


def survived(learner: PPO) -> float:
    """The share of a lap that the policy's mean action survives, over 32 starts."""
    fleet = RCLidarVectorEnv(32)
    states, _ = fleet.reset(seed=1_000)
    alive, steps = np.ones(32, dtype=bool), np.zeros(32)
    for _ in range(fleet.episode_steps):
        actions, _ = learner.predict(states, deterministic=True)
        states, rewards, terminated, truncated, _ = fleet.step(actions)
        steps += rewards * alive
        alive &= ~(terminated | truncated)
    return float(steps.mean()) / fleet.episode_steps
