"""The collection in miniature: real environment, real PPO, a few hundred steps."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cyclopts import CoercionError, UnknownOptionError

from ssil_data.commands.output import Place
from ssil_data.errors import ConflictError, InvalidInputError, NotFoundError
from ssil_data.store import Store
from ssil_trainers.collection import racetrack as demonstrations
from ssil_trainers.collection.policy_selection import drives_within
from ssil_trainers.collection.ppo import Checkpoint, PPOSettings, train
from ssil_trainers.collection.quality_tiers import BANDS, Band
from ssil_trainers.collection.racetrack import Collected, RacetrackSettings, collect_racetrack
from ssil_trainers.collection.racetrack_card import racetrack_card
from ssil_trainers.collection.recording import EvaluationCourse
from ssil_trainers.commands.collect import collect, racetrack
from ssil_trainers.envs.racetrack.env import STATE_NAMES, RacetrackEnv

SMALL = PPOSettings(512, learning_rate=3e-4, environments=2, rollout=128, batch=128, epochs=2)
MINIATURE = RacetrackSettings(
    labeled=50,
    unlabeled=90,
    segment=20,
    runs=1,
    policies=2,
    measure=2,
    episode_steps=40,
    expert_steps=1_024,
    under_trained_steps=1_024,
)
WIDE = tuple(Band(band.tier, -9.0, 99.0) for band in BANDS)
"""Bands that any driver falls into: a few hundred steps make no expert."""


@cache
def miniature(seed: int) -> Collected:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demonstrations, "BANDS", WIDE)
        return collect_racetrack(seed=seed, settings=MINIATURE)


def test_a_collection_has_exactly_the_wanted_pairs_of_every_kind() -> None:
    episodes = miniature(0).episodes()
    pairs: dict[tuple[str | None, bool], int] = {}
    for episode in episodes:
        kind = (episode.tier, episode.labeled)
        pairs[kind] = pairs.get(kind, 0) + len(episode)
    assert pairs == {
        ("expert", True): 50,
        ("expert", False): 90,
        ("0-25", False): 30,
        ("25-50", False): 30,
        ("50-75", False): 30,
    }
    assert all(len(episode) <= 20 for episode in episodes if episode.labeled)
    assert all(episode.labeled for episode in episodes[:3])


def test_no_two_episodes_share_a_start() -> None:
    starts = [tuple(episode.states[0]) for episode in miniature(0).episodes()]
    assert len(set(starts)) == len(starts)


def test_scores_are_returns_of_whole_episodes_over_the_experts_mean() -> None:
    collected = miniature(0)
    expert = [taken for taken in collected.taken if taken.tier == "expert"]
    assert np.mean([taken.score for taken in expert]) == pytest.approx(1.0)
    for taken, episode in zip(collected.taken, collected.episodes(), strict=True):
        assert taken.drive.total == pytest.approx(taken.score * collected.expert_return)
        assert (episode.ending == "cut") == (len(episode) < len(taken.drive))
        assert episode.source == taken.drive.driver


def test_same_seed_same_demonstrations_and_another_seed_others() -> None:
    miniature.cache_clear()
    first = miniature(0)
    miniature.cache_clear()
    second, other = miniature(0), miniature(1)
    for one, two in zip(first.episodes(), second.episodes(), strict=True):
        np.testing.assert_array_equal(one.states, two.states)
        np.testing.assert_array_equal(one.actions, two.actions)
    assert (first.episodes()[0].states[0] != other.episodes()[0].states[0]).any()


def test_negative_drives_score_inside_their_band_and_drivers_take_turns() -> None:
    checkpoints = [_parked(name) for name in ("one", "two")]
    course = EvaluationCourse(RacetrackEnv(episode_steps=30))
    band = Band("x", 0.0, 0.8)
    drives = drives_within(band, checkpoints, course, expert_return=300.0, patience=3_000)
    taken = [next(drives) for _ in range(6)]
    assert all(drive.total / 300.0 in band for drive in taken)
    assert {drive.driver for drive in taken} == {str(checkpoint) for checkpoint in checkpoints}


def test_drivers_who_never_score_inside_the_band_are_given_up() -> None:
    course = EvaluationCourse(RacetrackEnv(episode_steps=10))
    drives = drives_within(
        Band("x", 5.0, 6.0), [_parked("one")], course, expert_return=300.0, patience=50
    )
    with pytest.raises(NotFoundError, match=r"tier x: .* within 50 steps of .*one"):
        next(drives)


def test_a_checkpoint_acts_by_the_mean_of_the_policy_that_ppo_had() -> None:
    stretches: list[int] = []
    kept = train(RacetrackEnv, SMALL, run="r", seed=0, progress=stretches.append)
    assert [checkpoint.steps for checkpoint in kept] == [0, 256, 512]
    assert stretches == [0, 256]
    state = np.linspace(-1, 1, len(STATE_NAMES), dtype=np.float32)
    actions = [checkpoint(state) for checkpoint in kept]
    assert all(np.abs(action).max() <= 1 for action in actions)
    assert (actions[0] != actions[-1]).any()


def test_the_command_writes_a_dataset_with_its_card(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demonstrations, "BANDS", WIDE)
    place = Place(str(tmp_path))
    racetrack(seed=0, settings=MINIATURE, place=place)
    dataset = Store(tmp_path)["racetrack"]
    assert "--seed 0 --name racetrack --labeled 50 --unlabeled 90 --segment 20" in dataset.card
    assert len(dataset) == 50 + 90 + 90
    assert dataset.state_names == list(STATE_NAMES)
    with pytest.raises(ConflictError, match="found 'racetrack'"):
        racetrack(seed=0, settings=MINIATURE, place=place)


@pytest.mark.parametrize(
    "words",
    [
        "racetrack --laps 2",
        "racetrack --ahead 1.0",
        "rc-lidar --policy-hz 5",
        "rc-lidar --labeled 9",
    ],
)
def test_settings_of_another_world_are_refused(words: str) -> None:
    with pytest.raises(UnknownOptionError):
        collect(words, exit_on_error=False, print_error=False)


def test_a_track_of_another_world_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError, match=r"track: expected one of yard, .*, found 'oval'"):
        collect(f"rc-lidar --track oval --store {tmp_path}", exit_on_error=False)
    with pytest.raises(CoercionError):
        collect("racetrack --track yard", exit_on_error=False, print_error=False)


def test_the_card_tells_the_command_the_counts_and_the_measured_scores() -> None:
    collected = miniature(0)
    card = racetrack_card("small", collected, command="ssil-data collect racetrack --seed 0")
    labeled = sum(taken.labeled for taken in collected.taken)
    for expected in (
        "# small",
        "`ssil-data collect racetrack --seed 0`",
        "50 labeled expert pairs",
        f"| expert | yes | {labeled} | 50 |",
        "| 0-25 | no |",
        "Apache-2.0",
        "ppo expert checkpoint",
    ):
        assert expected in card


def test_unlabeled_pairs_that_three_tiers_cannot_share_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="multiple of 3, found 100"):
        replace(MINIATURE, unlabeled=100)


@pytest.mark.parametrize(
    "name",
    [
        *("labeled", "unlabeled", "segment", "runs", "policies", "measure", "episode_steps"),
        *("expert_steps", "under_trained_steps"),
    ],
)
@pytest.mark.parametrize("count", [0, -3])
def test_counts_that_are_not_positive_are_refused(name: str, count: int) -> None:
    with pytest.raises(InvalidInputError, match=f"^{name}: expected at least 1, found {count}$"):
        replace(MINIATURE, **{name: count})


@pytest.mark.parametrize("name", ["policies", "episode_steps", "policy_hz", "other_vehicles"])
def test_counts_that_are_not_whole_are_refused(name: str) -> None:
    with pytest.raises(InvalidInputError, match=f"^{name}: expected a whole number, found 2.5$"):
        replace(MINIATURE, **{name: 2.5})


@pytest.mark.parametrize("name", ["expert_learning_rate", "under_trained_learning_rate"])
@pytest.mark.parametrize("rate", [0, -1e-3, np.nan, np.inf])
def test_step_sizes_that_cannot_learn_are_refused(name: str, rate: float) -> None:
    with pytest.raises(
        InvalidInputError, match=f"^{name}: expected a finite number above 0, found {rate}$"
    ):
        replace(MINIATURE, **{name: rate})


@pytest.mark.parametrize("action_noise", [-0.1, np.nan, np.inf])
def test_action_noise_that_is_negative_or_not_finite_is_refused(action_noise: float) -> None:
    with pytest.raises(
        InvalidInputError,
        match=f"action_noise: expected a finite number of at least 0, found {action_noise}",
    ):
        replace(MINIATURE, action_noise=action_noise)


def test_a_driver_may_have_a_steady_hand() -> None:
    assert replace(MINIATURE, action_noise=0.0).action_noise == 0


def _parked(name: str) -> Checkpoint:
    """A driver who keeps the wheel and the throttle still."""
    weight = np.zeros((2, len(STATE_NAMES)), dtype=np.float32)
    return Checkpoint(name, 0, ((weight, np.zeros(2, dtype=np.float32)),))
