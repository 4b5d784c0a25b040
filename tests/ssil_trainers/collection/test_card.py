"""The cards of both worlds: the command, the counts, the measured scores, and the circumstances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from ssil_trainers.collection.card import render_card
from ssil_trainers.collection.racetrack import RacetrackSettings
from ssil_trainers.collection.rc_lidar import RCSettings
from support.small_collections import SMALL_RC, collect_small


def racetrack_card() -> str:
    return render_card(
        collect_small("racetrack", 0), name="small", command="ssil-data collect racetrack --seed 0"
    )


def rc_card(settings: RCSettings = SMALL_RC) -> str:
    """Return the card of the small collection as if it had been made with other settings."""
    collection = replace(collect_small("rc-lidar", 0), settings=settings)
    return render_card(collection, name="small", command="ssil-data collect rc-lidar --seed 0")


def test_the_racetracks_card_has_the_command_the_counts_and_the_measured_scores() -> None:
    card = racetrack_card()
    labeled = sum(selection.labeled for selection in collect_small("racetrack", 0).selections)
    for expected in (
        "# small\n",
        "`ssil-data collect racetrack --seed 0`",
        "50 labeled expert pairs",
        f"| expert | yes | {labeled} | 50 |",
        "| 0-25 | no |",
        "Apache-2.0",
        "ppo expert checkpoint",
    ):
        assert expected in card


def test_the_racetracks_card_explains_the_usual_noise_and_no_other() -> None:
    assert "below 0.3 their min–max leverage" in racetrack_card()
    collection = collect_small("racetrack", 0)
    other = replace(collection, settings=RacetrackSettings(action_noise=0.1))
    assert "below 0.3" not in render_card(other, name="small", command="")


def test_the_rc_cars_card_has_the_command_the_tracks_and_the_measured_scores() -> None:
    card = rc_card()
    for expected in (
        "# small\n",
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


def test_the_rc_cars_card_explains_the_usual_settings_and_no_others() -> None:
    assert "Two choices" not in rc_card()
    assert "Two choices" in rc_card(RCSettings())


@pytest.mark.parametrize(
    ("track", "phrase"),
    [
        ("yard", "Policies are trained on another one,\n  `hall`, and tested on `attic`"),
        ("seed-7", "Policies are trained on another one,\n  `hall`, and tested on `attic`"),
        ("hall", "on the track `hall`. Policies are trained on the same track.\n"),
        ("loft", "on the track `loft`. Policies are tested on the same track.\n"),
    ],
)
def test_the_card_calls_a_track_another_one_only_where_it_is(track: str, phrase: str) -> None:
    card = rc_card(replace(SMALL_RC, track=track))
    assert phrase in card
    assert ("another one" in card) == (track not in ("hall", "loft"))


def test_the_card_speaks_of_laps_where_they_are_whole() -> None:
    card = rc_card(replace(SMALL_RC, lap_steps=401))
    assert "2 expert laps of 401 pairs" in card
    assert "off after 401 steps, one lap." in card


@pytest.mark.parametrize("card", [racetrack_card, rc_card])
def test_cards_are_tidy_markdown(card: Callable[[], str]) -> None:
    text = card()
    assert text.endswith(" |\n")
    assert "\n\n\n" not in text
    assert not any(line.endswith(" ") for line in text.splitlines())
    for line in text.splitlines():
        if line.startswith("## "):
            assert f"\n\n{line}\n\n" in text
