"""Which policies stand for a tier, on scores made by hand."""

from __future__ import annotations

import pytest

from ssil_data.errors import NotFoundError
from ssil_trainers.collection.quality_tiers import BANDS, Band, select_policies

MIDDLE = BANDS[1]


def test_bands_meet_and_belong_to_one_tier_each() -> None:
    assert [band.tier for band in BANDS] == ["0-25", "25-50", "50-75"]
    for score in (0.0, 0.1, 0.25, 0.4999, 0.5, 0.74):
        assert sum(score in band for band in BANDS) == 1
    assert not any(score in band for band in BANDS for score in (-0.01, 0.75, 1.0))


def test_the_mean_and_half_of_the_episodes_must_lie_in_the_band() -> None:
    always, half, crashes_or_finishes, too_good = [0.3, 0.4], [0.3, 0.6], [0.0, 0.8], [0.5, 0.7]
    measured = [crashes_or_finishes, half, too_good, always]
    assert select_policies(measured, MIDDLE, at_most=9) == [3, 1]


def test_picked_policies_are_spread_evenly_over_their_means() -> None:
    measured = [[score] for score in (0.01, 0.02, 0.03, 0.9, 0.11, 0.24)]
    assert select_policies(measured, BANDS[0], at_most=3) == [0, 2, 5]
    assert select_policies(measured, BANDS[0], at_most=9) == [0, 1, 2, 4, 5]


def test_where_no_policy_is_often_in_the_band_the_one_that_is_most_often_stands_for_it() -> None:
    never, once = [0.0, 0.0, 0.9], [0.0, 0.4, 0.7]
    assert select_policies([never, once], MIDDLE, at_most=2) == [1]


@pytest.mark.parametrize("measured", [[[0.1], [0.9]], [[0.0, 0.8], [0.9]]])
def test_a_tier_without_a_policy_is_refused(measured: list[list[float]]) -> None:
    with pytest.raises(NotFoundError, match=r"tier 25-50: .* 0\.25 to 0\.50, .* among 2;"):
        select_policies(measured, MIDDLE, at_most=2)


def test_an_episode_on_the_edge_of_two_bands_belongs_to_the_upper_one() -> None:
    edge = Band("x", 0.25, 0.5)
    assert select_policies([[0.25], [0.5]], edge, at_most=2) == [0]
