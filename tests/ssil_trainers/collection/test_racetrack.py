"""The racetrack's collection: what is kept, and which settings are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssil_data.errors import InvalidInputError
from support.small_collections import SMALL_RACETRACK, collect_small


def test_a_collection_has_exactly_the_pairs_of_every_kind_that_the_settings_say() -> None:
    episodes = collect_small("racetrack", 0).episodes()
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


def test_the_first_pairs_of_an_episode_are_kept_and_shorter_ones_are_called_cut() -> None:
    collection = collect_small("racetrack", 0)
    for selection, episode in zip(collection.selections, collection.episodes(), strict=True):
        whole = selection.recorded
        np.testing.assert_array_equal(episode.states, whole.states[: len(episode)])
        assert (episode.ending == "cut") == (len(episode) < len(whole))


def test_unlabeled_pairs_that_three_tiers_cannot_share_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="multiple of 3, found 100"):
        replace(SMALL_RACETRACK, unlabeled=100)


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
        replace(SMALL_RACETRACK, **{name: count})


@pytest.mark.parametrize("name", ["policies", "episode_steps", "policy_hz", "other_vehicles"])
def test_counts_that_are_not_whole_are_refused(name: str) -> None:
    with pytest.raises(InvalidInputError, match=f"^{name}: expected a whole number, found 2.5$"):
        replace(SMALL_RACETRACK, **{name: 2.5})


@pytest.mark.parametrize("name", ["expert_learning_rate", "under_trained_learning_rate"])
@pytest.mark.parametrize("rate", [0, -1e-3, np.nan, np.inf])
def test_step_sizes_that_cannot_learn_are_refused(name: str, rate: float) -> None:
    with pytest.raises(
        InvalidInputError, match=f"^{name}: expected a finite number above 0, found {rate}$"
    ):
        replace(SMALL_RACETRACK, **{name: rate})


@pytest.mark.parametrize("action_noise", [-0.1, np.nan, np.inf])
def test_action_noise_that_is_negative_or_not_finite_is_refused(action_noise: float) -> None:
    with pytest.raises(
        InvalidInputError,
        match=f"action_noise: expected a finite number of at least 0, found {action_noise}",
    ):
        replace(SMALL_RACETRACK, action_noise=action_noise)


def test_drivers_may_act_without_noise() -> None:
    assert replace(SMALL_RACETRACK, action_noise=0.0).action_noise == 0
