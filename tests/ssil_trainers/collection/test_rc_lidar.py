"""The RC collection in miniature, its command and card; and the committed demonstrations."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ssil_data.commands.output import StoreLocation
from ssil_data.errors import ConflictError, InvalidInputError, NotFoundError
from ssil_data.quality import measure_quality
from ssil_data.scoring import preset, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_trainers.collection import rc_lidar as demonstrations
from ssil_trainers.collection.pure_pursuit import PurePursuit
from ssil_trainers.collection.quality_tiers import Band
from ssil_trainers.collection.rc_lidar import RC_BANDS, RCCollected, RCSettings, collect_rc
from ssil_trainers.collection.rc_lidar_card import rc_card
from ssil_trainers.collection.recording import EvaluationCourse
from ssil_trainers.commands.collect import rc_lidar as collect_command
from ssil_trainers.envs.rc_lidar.env import STATE_NAMES, RCLidarEnv
from ssil_trainers.envs.rc_lidar.tracks import TRAINING_TRACK, find_track
from support.demonstrations import DATASETS

COMMITTED = DATASETS / "rc-lidar"
TIERS = ["0-20", "20-40", "40-60", "60-80"]
MINIATURE = RCSettings(
    laps=2,
    lap_steps=60,
    negatives=43,
    segment=9,
    runs=1,
    policies=2,
    measure=2,
    under_trained_steps=1_024,
)
WIDE = tuple(Band(band.tier, -9.0, 99.0) for band in RC_BANDS)
"""Bands that any driver falls into: a thousand steps make no driver of every quality."""


@cache
def miniature(seed: int) -> RCCollected:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demonstrations, "RC_BANDS", WIDE)
        return collect_rc(seed=seed, settings=MINIATURE)


def test_a_collection_has_whole_laps_half_of_them_labeled_and_exactly_the_negatives() -> None:
    pairs: dict[tuple[str | None, bool], int] = {}
    for episode in miniature(0).episodes():
        kind = (episode.tier, episode.labeled)
        pairs[kind] = pairs.get(kind, 0) + len(episode)
    assert pairs == {
        ("expert", True): 60,
        ("expert", False): 60,
        ("0-20", False): 10,
        ("20-40", False): 11,
        ("40-60", False): 11,
        ("60-80", False): 11,
    }


def test_of_a_negative_drive_the_last_pairs_are_kept() -> None:
    for taken, episode in zip(miniature(0).taken, miniature(0).episodes(), strict=True):
        assert episode.ending == taken.recorded.ending
        np.testing.assert_array_equal(episode.states, taken.recorded.states[-len(episode) :])
        if episode.tier != "expert":
            assert len(episode) <= MINIATURE.segment


def test_scores_are_survived_steps_over_the_experts() -> None:
    collected = miniature(0)
    assert collected.expert_return == MINIATURE.lap_steps
    for taken in collected.taken:
        assert taken.score == pytest.approx(taken.recorded.total_reward / MINIATURE.lap_steps)
    assert all(t.score == 1 for t in collected.taken if t.tier == "expert")


def test_same_seed_same_demonstrations_and_another_seed_others() -> None:
    miniature.cache_clear()
    first = miniature(0)
    miniature.cache_clear()
    second, other = miniature(0), miniature(1)
    for one, two in zip(first.episodes(), second.episodes(), strict=True):
        np.testing.assert_array_equal(one.states, two.states)
        np.testing.assert_array_equal(one.actions, two.actions)
    assert (first.episodes()[0].states[0] != other.episodes()[0].states[0]).any()


def test_no_two_episodes_share_a_start() -> None:
    starts = [tuple(taken.recorded.states[0]) for taken in miniature(0).taken]
    assert len(set(starts)) == len(starts)


def test_the_expert_keeps_to_the_middle_of_a_track_it_has_never_seen() -> None:
    env = RCLidarEnv(TRAINING_TRACK)
    expert = PurePursuit(env, ahead=1.4)
    drive = EvaluationCourse(env, first_seed=0, action_noise=0.05).drive(expert)
    line = env.track.sample_poses(0.05)[:, :2]
    off = np.linalg.norm(drive.positions[:, None] - line[None], axis=2).min(axis=1)
    assert np.median(off) < 0.12
    assert str(expert) == "pure pursuit 1.4 m ahead"


def test_an_expert_that_collides_is_reported() -> None:
    with pytest.raises(NotFoundError, match=r"lap 0 by pure pursuit 0\.5 m ahead: expected 60"):
        collect_rc(seed=0, settings=replace(MINIATURE, ahead=0.5))


def test_the_command_writes_a_dataset_with_its_card(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demonstrations, "RC_BANDS", WIDE)
    place = StoreLocation(str(tmp_path))
    collect_command(seed=0, settings=MINIATURE, place=place)
    dataset = Store(tmp_path)["rc-lidar"]
    assert "rc-lidar --seed 0 --name rc-lidar --laps 2 --lap-steps 60" in dataset.card
    assert len(dataset) == 2 * 60 + 43
    assert dataset.state_names == list(STATE_NAMES)
    with pytest.raises(ConflictError, match="found 'rc-lidar'"):
        collect_command(seed=0, settings=MINIATURE, place=place)


def test_the_card_tells_the_command_the_tracks_and_the_measured_scores() -> None:
    card = rc_card("small", miniature(0), command="ssil-data collect rc-lidar --seed 0")
    for expected in (
        "# small",
        "`ssil-data collect rc-lidar --seed 0`",
        "2 expert drives of 60 pairs",
        "43 unlabeled negative pairs",
        "Collected on the track `yard`",
        "another one,\n  `hall`",
        "off after 60 steps, 0.15 of a lap.",
        "| expert | yes | 1 | 60 | 0 | 1.000 |",
        "| 60-80 | no |",
        "Apache-2.0",
        "ppo run 1 checkpoint",
    ):
        assert expected in card
    assert "Two choices" not in card, "told of the usual settings only"


@pytest.mark.parametrize(
    ("track", "told"),
    [
        ("yard", "Policies are trained on another one,\n  `hall`, and tested on `attic`"),
        ("seed-7", "Policies are trained on another one,\n  `hall`, and tested on `attic`"),
        ("hall", "on the track `hall`. It is no other than policies are trained on."),
        ("loft", "on the track `loft`. It is no other than policies are tested on."),
    ],
)
def test_the_card_calls_a_track_another_one_only_where_it_is(track: str, told: str) -> None:
    shifted = replace(miniature(0), settings=replace(MINIATURE, track=track))
    card = rc_card("shifted", shifted, command="ssil-data collect rc-lidar")
    assert told in card
    assert ("another one" in card) == (track not in ("hall", "loft"))


def test_the_card_speaks_of_laps_where_they_are_whole() -> None:
    whole = replace(miniature(0), settings=replace(MINIATURE, lap_steps=401))
    card = rc_card("laps", whole, command="ssil-data collect rc-lidar")
    assert "2 expert laps of 401 pairs" in card
    assert "off after 401 steps, one lap." in card


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"runs": 1.5}, "runs: expected a whole number, found 1.5"),
        (
            {"under_trained_learning_rate": np.nan},
            "under_trained_learning_rate: expected a finite number above 0, found nan",
        ),
        (
            {"under_trained_learning_rate": -1},
            "under_trained_learning_rate: expected a finite number above 0, found -1",
        ),
        ({"laps": 3}, "laps: expected an even number, found 3"),
        ({"laps": 0}, "laps: expected at least 1, found 0"),
        ({"negatives": 3}, "negatives: expected at least 4, found 3"),
        ({"segment": -1}, "segment: expected at least 1, found -1"),
        (
            {"action_noise": np.nan},
            "action_noise: expected a finite number of at least 0, found nan",
        ),
        ({"ahead": 0}, "ahead: expected a positive length, found 0"),
    ],
)
def test_what_cannot_be_collected_is_refused(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidInputError, match=f"^{message}$"):
        replace(MINIATURE, **wrong)


@pytest.fixture
def rc_lidar(tmp_path: Path) -> Dataset:
    shutil.copytree(COMMITTED, tmp_path / "rc-lidar")
    return Store(tmp_path)["rc-lidar"]


def test_the_committed_demonstrations_are_the_papers_mixture(rc_lidar: Dataset) -> None:
    labeled, tier = rc_lidar.per_pair("labeled").astype(bool), rc_lidar.per_pair("tier")
    names, counts = np.unique(tier[~labeled].astype(str), return_counts=True)
    assert labeled.sum() == 2_005
    assert set(tier[labeled]) == {"expert"}
    found = dict(zip(names.tolist(), counts.tolist(), strict=True))
    assert found.pop("expert") == 2_005
    assert sorted(found) == TIERS
    assert sum(found.values()) == 1_170
    assert all(250 <= count <= 300 for count in found.values())
    episodes = rc_lidar.episodes.to_pydict()
    expert = [
        length
        for length, t in zip(episodes["length"], episodes["tier"], strict=True)
        if t == "expert"
    ]
    assert expert == [401] * 10
    assert episodes["ending"].count("terminated") == 35
    assert rc_lidar.find_damage() == []


def test_the_committed_demonstrations_were_driven_on_the_collection_track(
    rc_lidar: Dataset,
) -> None:
    track, positions = find_track("yard"), rc_lidar.read_recorded("position")
    line = track.sample_poses(0.2)[:, :2]
    off = np.linalg.norm(positions[::7, None] - line[None], axis=2).min(axis=1)
    assert off.max() < 0.55


@pytest.mark.parametrize("kind", ["vae", "windowvae", "mdn"])
def test_experts_have_more_leverage_than_every_quality_of_negatives(
    rc_lidar: Dataset, kind: str
) -> None:
    run = score(rc_lidar, preset("default", kind), seed=0)
    found = measure_quality(rc_lidar, rc_lidar.leverage(run.name))
    means = found.mean_leverage_by_tier
    assert list(means) == [*TIERS, "expert"]
    assert all(means["expert"] > means[tier] + 0.05 for tier in TIERS)
    assert found.auroc > 0.75
