"""The RC car's collection: what is kept, the expert, and the committed demonstrations."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ssil_data.errors import InvalidInputError, NotFoundError
from ssil_data.quality import measure_quality
from ssil_data.scoring import preset, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_trainers.collection.collect import collect
from ssil_trainers.collection.pure_pursuit import PurePursuit
from ssil_trainers.collection.rc_lidar import RC_LIDAR
from ssil_trainers.collection.recording import EvaluationCourse
from ssil_trainers.envs.rc_lidar.env import RCLidarEnv
from ssil_trainers.envs.rc_lidar.tracks import TRAINING_TRACK, find_track
from support.demonstrations import DATASETS
from support.small_collections import SMALL_RC, collect_small

COMMITTED = DATASETS / "rc-lidar"
TIERS = ["0-20", "20-40", "40-60", "60-80"]


def test_a_collection_has_whole_laps_half_of_them_labeled_and_exactly_the_negatives() -> None:
    pairs: dict[tuple[str | None, bool], int] = {}
    for episode in collect_small("rc-lidar", 0).episodes():
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


def test_the_last_pairs_of_a_negative_episode_are_kept() -> None:
    collection = collect_small("rc-lidar", 0)
    for selection, episode in zip(collection.selections, collection.episodes(), strict=True):
        whole = selection.recorded
        assert episode.ending == whole.ending
        np.testing.assert_array_equal(episode.states, whole.states[-len(episode) :])
        if episode.tier != "expert":
            assert len(episode) <= SMALL_RC.segment


def test_scores_are_survived_steps_over_those_of_a_lap() -> None:
    collection = collect_small("rc-lidar", 0)
    assert collection.expert_return == SMALL_RC.lap_steps
    for selection in collection.selections:
        assert selection.score == pytest.approx(
            selection.recorded.total_reward / SMALL_RC.lap_steps
        )
    assert all(one.score == 1 for one in collection.selections if one.tier == "expert")


def test_the_expert_keeps_to_the_middle_of_a_track_it_has_never_seen() -> None:
    env = RCLidarEnv(TRAINING_TRACK)
    expert = PurePursuit(env, ahead=1.4)
    lap = EvaluationCourse(env, first_seed=0, action_noise=0.05).drive(expert)
    line = env.track.sample_poses(0.05)[:, :2]
    off = np.linalg.norm(lap.positions[:, None] - line[None], axis=2).min(axis=1)
    assert np.median(off) < 0.12
    assert str(expert) == "pure pursuit 1.4 m ahead"


def test_an_expert_that_collides_is_reported() -> None:
    with pytest.raises(
        NotFoundError, match=r"lap 0 by pure pursuit 0\.5 m ahead: collision after \d+ of 60 steps"
    ):
        collect(RC_LIDAR, replace(SMALL_RC, ahead=0.5), seed=0)


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
        replace(SMALL_RC, **wrong)


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
