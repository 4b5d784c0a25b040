"""Another track, another rate, other vehicles: what a shifted collection drives, and its card."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ssil_data.errors import InvalidInputError
from ssil_trainers.collection import racetrack as demonstrations
from ssil_trainers.collection.quality_tiers import BANDS, Band
from ssil_trainers.collection.racetrack import RacetrackSettings, collect_racetrack
from ssil_trainers.collection.racetrack_card import racetrack_card

TINY = RacetrackSettings(
    labeled=20,
    unlabeled=30,
    segment=10,
    runs=1,
    policies=1,
    measure=1,
    episode_steps=15,
    expert_steps=1_024,
    under_trained_steps=1_024,
)


@pytest.mark.parametrize(
    ("shift", "told"),
    [
        (
            {"track": "oval", "policy_hz": 5},
            ["`racetrack-oval-v1`", "one car, 20 Hz simulation, 5 Hz decisions"],
        ),
        (
            {"track": "large", "other_vehicles": 3},
            ["`racetrack-large-v1`", "one car among up to 3 of highway-env's", "10 Hz decisions"],
        ),
    ],
)
def test_a_shift_is_driven_and_told(
    shift: dict[str, Any], told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(demonstrations, "BANDS", [Band(b.tier, -9.0, 99.0) for b in BANDS])
    settings = replace(TINY, **shift)
    collected = collect_racetrack(seed=0, settings=settings)
    card = racetrack_card("shifted", collected, command="ssil-data collect racetrack")
    assert all(words in card for words in told)
    drive = max((taken.drive for taken in collected.taken), key=len)
    metres = np.linalg.norm(np.diff(drive.positions, axis=0), axis=1)
    speeds = 20 * np.hypot(drive.states[1:, 21], drive.states[1:, 22])
    # A decision lasts so long that the car gets about this far.
    np.testing.assert_allclose(metres * settings.policy_hz, speeds, atol=1.1)


@pytest.mark.parametrize(
    ("shift", "message"),
    [
        ({"track": "moon"}, "track: expected one of default, large, oval, found 'moon'"),
        ({"policy_hz": 6}, "policy_hz: expected a divisor of the simulation's 20 Hz, found 6"),
        ({"policy_hz": 2}, "policy_hz: expected at least 4, found 2"),
        ({"other_vehicles": -1}, "other_vehicles: expected at least 0, found -1"),
    ],
)
def test_a_shift_that_highway_env_cannot_make_is_refused(
    shift: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidInputError, match=message):
        replace(TINY, **shift)
