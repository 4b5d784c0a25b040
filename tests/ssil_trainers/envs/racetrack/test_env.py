"""The racetrack environment against both checkers, hand computations and highway-env itself."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as stable_baselines_check
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

import ssil_trainers.envs  # noqa: F401  registers the id
from ssil_data.errors import InvalidInputError
from ssil_data.store import Store
from ssil_trainers.envs.racetrack.env import HIGHWAY_IDS, STATE_NAMES, RacetrackEnv, TrackName
from ssil_trainers.envs.racetrack.starts import Start
from ssil_trainers.envs.racetrack.state import Car, observe, underlying_reward
from support.demonstrations import DATASETS

STRAIGHT_ON = np.array([0.3, 0.0], dtype=np.float32)


def steer_home(state: np.ndarray) -> np.ndarray:
    """A careful driver at 8 m/s: the steering angle of the curve, corrected towards the middle."""
    heading, offset, forward = state[19:22]
    slip = np.arcsin(2.5 * state[STATE_NAMES.index("curvature +5 m")] / 20)
    curve = np.arctan(2 * np.tan(slip)) / (np.pi / 4)
    return np.array([0.4 - forward, curve - heading - 0.2 * offset], dtype=np.float32)


def drive(env: RacetrackEnv, seed: int, steps: int) -> np.ndarray:
    """Return the states of a careful drive."""
    state, _ = env.reset(seed=seed)
    states = [state]
    for _ in range(steps):
        state, _, terminated, truncated, _ = env.step(steer_home(state))
        states.append(state)
        if terminated or truncated:
            break
    return np.array(states)


def test_gymnasiums_checker_accepts_it() -> None:
    gymnasium_check(gymnasium.make("SSILRacetrack-v0", render_mode="rgb_array").unwrapped)


def test_stable_baselines_checker_accepts_it() -> None:
    stable_baselines_check(RacetrackEnv())


@pytest.mark.parametrize("track", HIGHWAY_IDS)
def test_a_careful_driver_goes_round_every_track_and_sees_only_the_observation_space(
    track: TrackName,
) -> None:
    env = RacetrackEnv(track)
    states = drive(env, seed=3, steps=600)
    assert len(states) == 601
    assert states.shape[1] == len(STATE_NAMES) == 29
    assert all(env.observation_space.contains(state) for state in states)


@pytest.mark.slow
def test_ppo_learns_it_out_of_the_box() -> None:
    learner = PPO("MlpPolicy", make_vec_env("SSILRacetrack-v0", 8, seed=0), n_steps=256, seed=0)
    test = make_vec_env("SSILRacetrack-v0", 1, seed=100)
    before, _ = evaluate_policy(learner, test, n_eval_episodes=3, return_episode_rewards=True)
    learner.learn(8_192)
    after, _ = evaluate_policy(learner, test, n_eval_episodes=3, return_episode_rewards=True)
    # 1,000 steps as fast as the car goes are worth about 20,000.
    assert np.mean(before) < 2_000
    assert np.mean(after) > 10_000


def traffic(env: RacetrackEnv, *, ahead: float, speed: float = 0.0) -> None:
    """Put the only other vehicle so many meters ahead, in the middle of the car's lane."""
    (other,) = env._others()
    car, lane = env.car, env._simulator.vehicle.lane
    other.position = lane.position(car.longitudinal + ahead, 0.0)
    other.heading, other.speed, other.target_speed = lane.heading_at(0.0), speed, speed
    other.on_state_update()


def test_rays_stop_at_the_box_of_another_vehicle() -> None:
    env = RacetrackEnv(other_vehicles=1)
    env.reset(seed=0, options={"start": Start(0, 5.0, 0.0)})
    traffic(env, ahead=32.5)
    state, *_ = env.step(np.zeros(2, dtype=np.float32))
    # The box is 5 m long; the first straight goes on for longer.
    assert state[STATE_NAMES.index("ray 0°")] * 60 == pytest.approx(30.0, abs=0.01)
    free, _ = RacetrackEnv().reset(options={"start": Start(0, 5.0, 0.0)})
    others = [STATE_NAMES.index(f"ray {degrees}°") for degrees in (-90, -30, 30, 90)]
    np.testing.assert_allclose(state[others], free[others], atol=1e-6)


def test_hitting_another_vehicle_ends_the_episode_on_the_road() -> None:
    env = RacetrackEnv(other_vehicles=1)
    env.reset(seed=0, options={"start": Start(0, 5.0, 15.0)})
    traffic(env, ahead=20.0)
    ended, steps = False, 0
    while not ended:
        _, _, ended, truncated, _ = env.step(np.zeros(2, dtype=np.float32))
        steps += 1
        assert not truncated
    assert 8 <= steps <= 11  # 15 m from bumper to bumper at 15 m/s
    assert abs(env.car.lateral) < 0.1


def test_starts_are_clear_of_other_vehicles_and_drawn_by_the_seed() -> None:
    env, again = RacetrackEnv(other_vehicles=8), RacetrackEnv(other_vehicles=8)
    counts = set()
    for seed in range(15):
        state, info = env.reset(seed=seed)
        away = [np.linalg.norm(v.position - info["position"]) for v in env._others()]
        assert min(away) >= 20
        counts.add(len(away))
        np.testing.assert_array_equal(state, again.reset(seed=seed)[0])
        for _ in range(5):
            action = steer_home(state)
            state, *_ = env.step(action)
            np.testing.assert_array_equal(state, again.step(action)[0])
    assert min(counts) < max(counts) <= 8


def test_traffic_stays_in_the_observation_space() -> None:
    stable_baselines_check(RacetrackEnv("oval", other_vehicles=4, policy_hz=5))
    with pytest.raises(InvalidInputError, match="other_vehicles: expected at least 0, found -1"):
        RacetrackEnv(other_vehicles=-1)


def test_wild_driving_stays_in_the_observation_space() -> None:
    env = RacetrackEnv()
    rng = np.random.default_rng(0)
    for seed in range(40):
        state, _ = env.reset(seed=seed)
        ended = False
        while not ended:
            assert env.observation_space.contains(state), state
            state, _, ended, _, _ = env.step(rng.uniform(-1, 1, 2).astype(np.float32) * 1.5)
        assert env.observation_space.contains(state), state


def test_same_seed_same_trajectory() -> None:
    first, second = RacetrackEnv(), RacetrackEnv()
    drive(second, seed=1, steps=20)
    np.testing.assert_array_equal(drive(first, 5, steps=100), drive(second, 5, steps=100))


def test_committed_demonstrations_repeat() -> None:
    dataset, env = Store(DATASETS)["racetrack"], RacetrackEnv()
    for episode, seed in ((0, 80), (214, 1067)):  # found by trying
        recorded = dataset.episode(episode)
        state, _ = env.reset(seed=seed)
        for expected, action in zip(recorded.states, recorded.actions, strict=True):
            np.testing.assert_allclose(state, expected, rtol=0, atol=1e-6)
            state, *_ = env.step(action)


@pytest.mark.parametrize("policy_hz", [5, 20])
def test_a_decision_lasts_as_long_as_the_rate_says(policy_hz: int) -> None:
    env = RacetrackEnv("oval", policy_hz=policy_hz)
    assert env.metadata["render_fps"] == policy_hz
    _, info = env.reset(options={"start": Start(0, 20.0, 10.0)})
    onward = env.step(np.zeros(2, dtype=np.float32))[4]
    assert np.linalg.norm(onward["position"] - info["position"]) == pytest.approx(10 / policy_hz)


def test_a_rate_that_highway_env_would_round_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="divisor of the simulation's 20 Hz, found 6"):
        RacetrackEnv(policy_hz=6)


def test_an_action_that_is_not_finite_is_refused() -> None:
    env = RacetrackEnv()
    env.reset(seed=0)
    with pytest.raises(InvalidInputError, match=r"found \[nan  0.\]"):
        env.step(np.array([np.nan, 0.0], dtype=np.float32))


def test_starts_vary_along_the_lap() -> None:
    env = RacetrackEnv()
    starts = np.array([env.reset(seed=seed)[1]["position"] for seed in range(60)])
    lanes = {(env.reset(seed=seed), env.car.lane)[1] for seed in range(60)}
    assert np.ptp(starts, axis=0).min() > 50
    assert len(lanes) > 8


def test_leaving_the_road_ends_the_episode_where_the_edge_is() -> None:
    env = RacetrackEnv()
    env.reset(seed=2)
    terminated, offsets = False, []
    while not terminated:
        state, _, terminated, truncated, _ = env.step(STRAIGHT_ON)
        offsets.append(abs(float(state[STATE_NAMES.index("lateral offset")])))
        assert not truncated
    assert offsets[-1] > 1 >= max(offsets[:-1])


def test_changing_lanes_is_not_leaving_the_road_even_where_the_lanes_lie_apart() -> None:
    env = RacetrackEnv()
    env.reset(seed=0)
    vehicle, network = env._simulator.vehicle, env._simulator.road.network
    left, right = network.graph["f"]["g"]
    between = (left.position(10.0, 2.5) + right.position(10.0, -2.5)) / 2
    vehicle.position, vehicle.heading, vehicle.speed = between, left.heading_at(0.0), 0.0
    vehicle.on_state_update()
    assert not vehicle.on_road
    assert not env.step(np.zeros(2, dtype=np.float32))[2]


def test_the_time_limit_truncates() -> None:
    env = RacetrackEnv(episode_steps=7)
    state, _ = env.reset(seed=0)
    ends = []
    for _ in range(7):
        state, _, terminated, truncated, _ = env.step(steer_home(state))
        ends.append((terminated, truncated))
    assert ends == [(False, False)] * 6 + [(False, True)]


def test_reward_against_a_hand_computation() -> None:
    road = RacetrackEnv().road
    # v = 10, 30° to the right of the lane, steering so that tan β = ½ tan δ = 0.3.
    steering = float(np.arctan(0.6) / (np.pi / 4))
    car = Car(0, 0, 0, 10.0, 1, 0.0, -0.5, np.pi / 6, throttle=0.2, steering=steering)
    v_x, v_y = 10 / np.sqrt(1.09), 3 / np.sqrt(1.09)
    d = (2.5 - 0.5) / 5  # the right one of two lanes
    expected = v_x * np.sqrt(3) / 2 - v_y / 2 - 2 * v_x * d / 2 - v_y * np.sqrt(3) / 2
    assert underlying_reward(road, car) == pytest.approx(expected, rel=1e-12)


def test_motion_and_curvature_in_the_state_against_a_hand_computation() -> None:
    road = RacetrackEnv().road
    # The right lane of the first straight, 7 m before the left turn of radius 25 m.
    car = Car(93.0, 5.0, 0.1, 8.0, 1, 51.0, 0.0, 0.1, throttle=-0.5, steering=0.0)
    expected = [0.1, 0.5, 0.4, 0.0, 0.0, -0.5, 0.0, 0.0, -20 / 25, -20 / 25]
    np.testing.assert_allclose(observe(road, car)[19:], expected, atol=1e-12)


def test_info_tells_the_reward_and_where_the_car_is() -> None:
    env = RacetrackEnv()
    env.reset(seed=0)
    _, reward, _, _, info = env.step(STRAIGHT_ON)
    assert info["underlying_reward"] == reward
    np.testing.assert_array_equal(info["position"], env._simulator.vehicle.position)


def test_rendering_gives_a_picture_only_with_a_render_mode() -> None:
    env = RacetrackEnv(render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (600, 600, 3)
    assert picture.dtype == np.uint8
    assert np.ptp(picture) > 0
    env.close()
    assert RacetrackEnv().render() is None
