"""Bands of scores: they meet, and every score belongs to one tier."""

from __future__ import annotations

import pytest

from ssil_trainers.collection.quality_tiers import Band
from ssil_trainers.collection.racetrack import BANDS
from ssil_trainers.collection.rc_lidar import RC_BANDS


@pytest.mark.parametrize("bands", [BANDS, RC_BANDS])
def test_bands_meet_and_belong_to_one_tier_each(bands: tuple[Band, ...]) -> None:
    top = bands[-1].high
    for score in (0.0, 0.1, 0.2, 0.25, 0.4999, 0.5, 0.74):
        assert sum(score in band for band in bands) == 1
    assert not any(score in band for band in bands for score in (-0.01, top, 1.0))


def test_tiers_are_the_papers() -> None:
    assert [band.tier for band in BANDS] == ["0-25", "25-50", "50-75"]
    assert [band.tier for band in RC_BANDS] == ["0-20", "20-40", "40-60", "60-80"]
    assert [(band.low, band.high) for band in BANDS] == [(0.0, 0.25), (0.25, 0.5), (0.5, 0.75)]
    assert [band.low for band in RC_BANDS] == [0.0, 0.2, 0.4, 0.6]
    assert RC_BANDS[-1].high == 0.8
