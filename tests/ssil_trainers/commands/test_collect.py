"""The command `ssil-data collect` in miniature: what it writes, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from cyclopts import CoercionError, UnknownOptionError

from ssil_data.commands.output import StoreLocation
from ssil_data.errors import ConflictError, NotFoundError
from ssil_data.store import Store
from ssil_trainers.commands import collect as command
from support.small_collections import SMALL_RACETRACK, SMALL_RC, SMALL_WORLDS


def test_a_racetrack_dataset_is_written_with_its_card(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world, _ = SMALL_WORLDS["racetrack"]
    monkeypatch.setattr(command, "RACETRACK", world)
    location = StoreLocation(str(tmp_path))
    command.racetrack(seed=0, settings=SMALL_RACETRACK, location=location)
    dataset = Store(tmp_path)["racetrack"]
    assert "--seed 0 --name racetrack --labeled 50 --unlabeled 90 --segment 20" in dataset.card
    assert len(dataset) == 50 + 90 + 90
    assert dataset.state_names == list(world.state_names)
    with pytest.raises(ConflictError, match="dataset: 'racetrack' already exists"):
        command.racetrack(seed=0, settings=SMALL_RACETRACK, location=location)


def test_an_rc_dataset_is_written_with_its_card(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    world, _ = SMALL_WORLDS["rc-lidar"]
    monkeypatch.setattr(command, "RC_LIDAR", world)
    location = StoreLocation(str(tmp_path))
    command.rc_lidar(seed=0, settings=SMALL_RC, location=location)
    dataset = Store(tmp_path)["rc-lidar"]
    assert "rc-lidar --seed 0 --name rc-lidar --laps 2 --lap-steps 60" in dataset.card
    assert len(dataset) == 2 * 60 + 43
    assert dataset.state_names == list(world.state_names)
    with pytest.raises(ConflictError, match="dataset: 'rc-lidar' already exists"):
        command.rc_lidar(seed=0, settings=SMALL_RC, location=location)


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
        command.collect(words, exit_on_error=False, print_error=False)


def test_a_track_of_another_world_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError, match=r"track: expected one of yard, .*, found 'oval'"):
        command.collect(f"rc-lidar --track oval --store {tmp_path}", exit_on_error=False)
    with pytest.raises(CoercionError):
        command.collect("racetrack --track yard", exit_on_error=False, print_error=False)
