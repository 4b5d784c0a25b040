"""Which policies stand for a tier, on scores made by hand, and which episodes are kept."""

from __future__ import annotations

import numpy as np
import pytest

from ssil_data.errors import NotFoundError
from ssil_trainers.collection.policy_selection import episodes_within, select_policies
from ssil_trainers.collection.ppo import Checkpoint
from ssil_trainers.collection.quality_tiers import Band
from ssil_trainers.collection.racetrack import BANDS
from ssil_trainers.collection.recording import EvaluationCourse
from ssil_trainers.envs.racetrack.env import STATE_NAMES, RacetrackEnv

MIDDLE = BANDS[1]


def test_the_mean_and_half_of_the_episodes_must_lie_in_the_band() -> None:
    always = [0.3, 0.4]
    half = [0.3, 0.6]
    crashes_or_finishes = [0.0, 0.8]
    too_good = [0.5, 0.7]
    scores = [crashes_or_finishes, half, too_good, always]
    assert select_policies(scores, MIDDLE, at_most=9) == [3, 1]


def test_selected_policies_are_spread_evenly_over_their_means() -> None:
    scores = [[score] for score in (0.01, 0.02, 0.03, 0.9, 0.11, 0.24)]
    assert select_policies(scores, BANDS[0], at_most=3) == [0, 2, 5]
    assert select_policies(scores, BANDS[0], at_most=9) == [0, 1, 2, 4, 5]


def test_where_no_policy_is_often_in_the_band_the_one_that_is_most_often_stands_for_it() -> None:
    never = [0.0, 0.0, 0.9]
    once = [0.0, 0.4, 0.7]
    assert select_policies([never, once], MIDDLE, at_most=2) == [1]


@pytest.mark.parametrize(("scores", "means"), [([[0.1], [0.9]], 0), ([[0.0, 0.8], [0.9]], 1)])
def test_a_tier_without_a_policy_is_refused(scores: list[list[float]], means: int) -> None:
    with pytest.raises(
        NotFoundError, match=rf"tier 25-50: .* 0\.25 to 0\.50; of 2 policies, {means} have"
    ):
        select_policies(scores, MIDDLE, at_most=2)


def test_an_episode_on_the_edge_of_two_bands_belongs_to_the_upper_one() -> None:
    edge = Band("x", 0.25, 0.5)
    assert select_policies([[0.25], [0.5]], edge, at_most=2) == [0]


def test_kept_episodes_score_inside_their_band_and_drivers_take_turns() -> None:
    drivers = [_parked(name) for name in ("one", "two")]
    course = EvaluationCourse(RacetrackEnv(episode_steps=30))
    band = Band("x", 0.0, 0.8)
    found = episodes_within(band, drivers, course, expert_return=300.0, patience=3_000)
    episodes = [next(found) for _ in range(6)]
    assert all(episode.total_reward / 300.0 in band for episode in episodes)
    assert {episode.driver for episode in episodes} == {str(driver) for driver in drivers}


def test_a_tier_whose_drivers_never_score_inside_its_band_is_given_up() -> None:
    course = EvaluationCourse(RacetrackEnv(episode_steps=10))
    found = episodes_within(
        Band("x", 5.0, 6.0), [_parked("one")], course, expert_return=300.0, patience=50
    )
    with pytest.raises(NotFoundError, match=r"tier x: .* within 50 steps of .*one"):
        next(found)


def _parked(name: str) -> Checkpoint:
    """Return a driver that keeps the wheel and the throttle still."""
    weight = np.zeros((2, len(STATE_NAMES)), dtype=np.float32)
    return Checkpoint(name, 0, ((weight, np.zeros(2, dtype=np.float32)),))
