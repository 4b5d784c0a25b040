"""The racetrack's twin against the real environment in lock-step, and against gymnasium's rules."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_match import check_environments_match
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import ssil_trainers.envs  # noqa: F401  registers the id
from ssil_data.store import Store
from ssil_trainers.envs.racetrack.env import HIGHWAY_IDS, RacetrackEnv, TrackName
from ssil_trainers.envs.racetrack.starts import Start
from ssil_trainers.envs.racetrack.state import observe
from ssil_trainers.envs.racetrack.vector_env import RacetrackVectorEnv
from support.demonstrations import DATASETS

CARS = 12


def expert_like(states: np.ndarray) -> np.ndarray:
    """Drivers (n, 2) that keep to the middle and brake for curves: 11 to 15 m/s on average."""
    heading, offset, speed = states[:, 19], states[:, 20], 20 * states[:, 21]
    slip = np.arcsin(np.clip(2.5 * states[:, 26] / 20, -0.9, 0.9))
    curve = np.arctan(2 * np.tan(slip)) / (np.pi / 4)
    tightest = np.abs(states[:, 26:]).max(axis=1) / 20
    target = np.minimum(19.0, np.sqrt(6 / np.maximum(tightest, 1e-3)))
    steering = curve - (heading + 0.25 * offset) * 10 / np.maximum(speed, 5.0)
    return np.stack([(target - speed) / 2, steering], axis=1).astype(np.float32)


def mixed(states: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A third drives like an expert, a third with noise, a third does anything at all."""
    actions = expert_like(states)
    noisy, wild = np.arange(len(states)) % 3 == 1, np.arange(len(states)) % 3 == 2
    actions[noisy] += rng.normal(scale=0.3, size=(noisy.sum(), 2))
    actions[wild] = rng.uniform(-1.5, 1.5, size=(wild.sum(), 2))
    return actions.astype(np.float32)


def side_by_side(mode: AutoresetMode = AutoresetMode.NEXT_STEP, **settings: Any) -> Any:
    """Return real environments and their twin, reset with the same seed."""
    real = SyncVectorEnv([lambda: RacetrackEnv(**settings)] * CARS, autoreset_mode=mode)
    twin = RacetrackVectorEnv(CARS, autoreset_mode=mode, **settings)
    return real, twin


def assert_same(one: Any, other: Any) -> None:
    """Compare infos, however nested, arrays of objects included."""
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_same(one[key], other[key])
    elif isinstance(one, np.ndarray) and one.dtype == object:
        for left, right in zip(one, other, strict=True):
            assert_same(left, right)
    elif one is not None:
        assert one.dtype == other.dtype
        np.testing.assert_allclose(
            one, other, rtol=0, atol=1e-6 if one.dtype.itemsize == 4 else 1e-9
        )


@pytest.mark.parametrize("policy_hz", [10, 5])
@pytest.mark.parametrize("track", HIGHWAY_IDS)
def test_the_twin_is_the_real_environment(track: TrackName, policy_hz: int) -> None:
    real, twin = side_by_side(track=track, policy_hz=policy_hz, episode_steps=50)
    rng, ends = np.random.default_rng(policy_hz), 0
    seen, _ = real.reset(seed=40)
    twin.reset(seed=40)
    for _ in range(70):
        states = [observe(env.road, env.car) for env in real.envs]
        np.testing.assert_allclose(twin._output.states, states, rtol=0, atol=1e-9)
        assert [twin.car(car).lane for car in range(CARS)] == [env.car.lane for env in real.envs]
        actions = mixed(seen, rng)
        seen, rewards, terminated, truncated, info = real.step(actions)
        twin_seen, *twin_results = twin.step(actions)
        for expected, found in zip(
            (rewards, terminated, truncated, info), twin_results, strict=True
        ):
            assert_same(expected, found)
        assert twin_seen.dtype == seen.dtype
        ends += terminated.sum()
    assert ends > 5


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_episodes_end_and_begin_as_in_gymnasiums_own_vector_environment(
    mode: AutoresetMode,
) -> None:
    real, twin = side_by_side(mode, episode_steps=4)
    assert twin.metadata["autoreset_mode"] == mode
    rng = np.random.default_rng(0)
    assert_same(real.reset(seed=3)[1], twin.reset(seed=3)[1])
    for _ in range(15):
        actions = rng.uniform(-1, 1, size=(CARS, 2)).astype(np.float32)
        for expected, found in zip(real.step(actions), twin.step(actions), strict=True):
            assert_same(expected, found)


def test_braking_to_a_stand_and_backwards_is_the_same_on_either() -> None:
    real, twin = side_by_side(episode_steps=100)
    start = Start(lane=0, longitudinal=5.0, speed=3.0)
    real.reset(seed=0, options={"start": start})
    twin.reset(seed=0, options={"start": [start] * CARS})
    actions = np.full((CARS, 2), -1.0, dtype=np.float32)
    actions[:, 1] = np.linspace(-0.5, 0.5, CARS)
    for _ in range(25):
        real.step(actions)
        twin.step(actions)
        for car, env in enumerate(real.envs):
            assert twin.car(car).speed == pytest.approx(env.car.speed, abs=1e-9)
        np.testing.assert_allclose(
            twin._output.states,
            [observe(env.road, env.car) for env in real.envs],
            rtol=0,
            atol=1e-9,
        )
    assert min(twin.car(car).speed for car in range(CARS)) > -0.6, "as slow as highway-env allows"


def test_committed_demonstrations_are_what_the_twin_sees() -> None:
    dataset = Store(DATASETS)["racetrack"]
    length = len(dataset.episode(0))
    of_six = slice(6 * length)  # the labeled episodes are equally long and come first
    states, actions = dataset.pairs().states[of_six], dataset.pairs().actions[of_six]
    places, rewards = (
        dataset.read_recorded("position")[of_six],
        dataset.read_recorded("reward")[of_six],
    )
    twin = RacetrackVectorEnv(6)
    seen, info = twin.reset(seed=80)  # the first one's seed, found by trying
    for step in range(length):
        now = slice(step, None, length)
        np.testing.assert_allclose(seen, states[now], rtol=0, atol=1e-6)
        np.testing.assert_allclose(info["position"], places[now], rtol=1e-6)
        seen, found, _, _, info = twin.step(actions[now])
        np.testing.assert_allclose(found, rewards[now], rtol=1e-5)


def drive(envs: RacetrackVectorEnv, car: int, *, seed: int, steps: int = 150) -> np.ndarray:
    """Return the states of one wild car whose neighbors drive otherwise; it starts anew often."""
    rng = np.random.default_rng(9)
    states = [envs.reset(seed=seed)[0][car]]
    for _ in range(steps):
        actions = rng.uniform(-1, 1, size=(envs.num_envs, 2)).astype(np.float32)
        actions[car] = np.sin(len(states) * np.array([0.7, 0.3]))
        states.append(envs.step(actions)[0][car])
    return np.array(states)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_car_drives_as_if_it_were_alone(mode: AutoresetMode) -> None:
    alone = drive(RacetrackVectorEnv(1, autoreset_mode=mode), 0, seed=17)
    among = drive(RacetrackVectorEnv(31, autoreset_mode=mode), 12, seed=5)
    np.testing.assert_array_equal(alone, among)


def test_same_seed_same_trajectories_whatever_was_driven_before() -> None:
    fresh, used = RacetrackVectorEnv(5), RacetrackVectorEnv(5)
    drive(used, 1, seed=99)
    np.testing.assert_array_equal(drive(fresh, 3, seed=2), drive(used, 3, seed=2))
    assert fresh.np_random_seed == (2, 3, 4, 5, 6)
    for one, other in zip(fresh.np_random, used.np_random, strict=True):
        assert one.bit_generator.state == other.bit_generator.state


def test_make_vec_gives_the_twin_and_it_matches_the_real_environment() -> None:
    twin = gymnasium.make_vec("SSILRacetrack-v0", num_envs=1, track="oval", episode_steps=20)
    assert isinstance(twin, RacetrackVectorEnv)
    real = gymnasium.make_vec(
        "SSILRacetrack-v0", num_envs=1, vectorization_mode="sync", track="oval", episode_steps=20
    )
    assert twin.observation_space == real.observation_space
    check_environments_match(twin, real, num_steps=60, info_comparison="equivalence")
    twin.close()
    twin.close()


def test_states_stay_in_the_observation_space_and_belong_to_the_caller() -> None:
    envs = RacetrackVectorEnv(40, track="large", autoreset_mode="SameStep")
    rng = np.random.default_rng(3)
    states, _ = envs.reset(seed=0)
    kept, copies = [states], [states.copy()]
    for _ in range(60):
        states, *_ = envs.step(rng.uniform(-1, 1, size=(40, 2)).astype(np.float32))
        assert envs.observation_space.contains(states)
        kept.append(states)
        copies.append(states.copy())
    np.testing.assert_array_equal(kept, copies)


def test_gymnasiums_wrappers_add_up_the_reward() -> None:
    envs = RecordEpisodeStatistics(RacetrackVectorEnv(3, episode_steps=5))
    states, _ = envs.reset(seed=1)
    total, info = np.zeros(3), {}
    for _ in range(5):
        states, rewards, _, _, info = envs.step(expert_like(states))
        total += rewards
    np.testing.assert_allclose(info["episode"]["r"], total, rtol=1e-6)


def test_told_starts_are_kept_on_either_side() -> None:
    start = Start(lane=7, longitudinal=12.5, speed=11.0)
    real, twin = RacetrackEnv(), RacetrackVectorEnv(2)
    seen, info = real.reset(seed=0, options={"start": start})
    assert real.start == start
    assert real.car.speed == 11.0
    assert real.car.longitudinal == pytest.approx(12.5)
    both, infos = twin.reset(seed=0, options={"start": [start, start]})
    np.testing.assert_allclose(both, [seen, seen], rtol=0, atol=1e-6)
    np.testing.assert_allclose(infos["position"], [info["position"]] * 2)
    assert twin.starts == [start, start]


def test_starts_that_were_drawn_can_be_told_to_the_real_environment() -> None:
    real, twin = RacetrackEnv("oval"), RacetrackVectorEnv(4, "oval")
    states, _ = twin.reset(seed=11)
    for state, start in zip(states, twin.starts, strict=True):
        np.testing.assert_allclose(
            real.reset(options={"start": start})[0], state, rtol=0, atol=1e-6
        )


def test_starts_are_drawn_as_numpys_choice_would() -> None:
    road = RacetrackEnv("large").road
    length = road.lanes.length
    for seed in range(50):
        rng, other = np.random.default_rng(seed), np.random.default_rng(seed)
        start = Start.draw(road, rng)
        assert start.lane == other.choice(len(length), p=length / length.sum())
        assert start.longitudinal == other.uniform(0.0, length[start.lane])
        assert start.speed == other.uniform(5.0, 15.0)


def test_a_mask_starts_only_some_cars_anew() -> None:
    envs = RacetrackVectorEnv(3, episode_steps=3, autoreset_mode=AutoresetMode.DISABLED)
    before, _ = envs.reset(seed=0)
    truncated = np.zeros(3, dtype=bool)
    for _ in range(3):
        before, _, _, truncated, _ = envs.step(expert_like(before))
    assert truncated.all()
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"\[0 1 2\]"):
        envs.step(expert_like(before))
    mask = np.array([True, False, True])
    after, info = envs.reset(seed=[5, None, 7], options={"reset_mask": mask})
    np.testing.assert_array_equal(after[1], before[1])
    np.testing.assert_array_equal(info["_position"], mask)
    np.testing.assert_array_equal(after[2], RacetrackVectorEnv(1).reset(seed=7)[0][0])
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"\[1\]"):
        envs.step(expert_like(after))
