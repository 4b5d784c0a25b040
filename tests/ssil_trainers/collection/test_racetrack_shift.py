"""A shifted racetrack (another track, rate, traffic): what is driven, and what the card says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ssil_data.errors import InvalidInputError
from ssil_trainers.collection.card import render_card
from ssil_trainers.collection.collect import collect
from ssil_trainers.collection.racetrack import RACETRACK, RacetrackSettings
from support.small_collections import with_wide_bands

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
    ("shift", "phrases"),
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
def test_a_shift_is_driven_and_described(shift: dict[str, Any], phrases: list[str]) -> None:
    settings = replace(TINY, **shift)
    collection = collect(with_wide_bands(RACETRACK), settings, seed=0)
    card = render_card(collection, name="shifted", command="ssil-data collect racetrack")
    assert all(phrase in card for phrase in phrases)
    longest = max((selection.recorded for selection in collection.selections), key=len)
    meters = np.linalg.norm(np.diff(longest.positions, axis=0), axis=1)
    speeds = 20 * np.hypot(longest.states[1:, 21], longest.states[1:, 22])
    # A decision lasts so long that the car gets about this far.
    np.testing.assert_allclose(meters * settings.policy_hz, speeds, atol=1.1)


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
