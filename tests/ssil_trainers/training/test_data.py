"""What is known about the demonstrations that a run learns from."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ssil_data.demonstrations import Episode
from ssil_data.store import Store
from ssil_trainers.training.data import TrainingData
from ssil_trainers.training.expert_return import measure_expert_return, without_noise
from ssil_trainers.training.label_subset import limit_labels
from support.demonstrations import ACTION_NAMES, DATASETS, STATE_NAMES, drive, drives


def test_the_experts_return_is_the_return_of_score_one(store: Store) -> None:
    def episode(score: float | None, ending: str, total: float) -> Episode:
        plain = drive(1, 10, score=score, ending=ending)
        return replace(plain, rewards=np.full(10, total / 10, np.float32))

    names = {"state_names": STATE_NAMES, "action_names": ACTION_NAMES}
    whole = [episode(0.5, "terminated", 10.0), episode(1.1, "truncated", 22.0)]
    made = store.create("whole", [*whole, episode(0.9, "cut", 3.0)], **names)
    assert measure_expert_return(made) == pytest.approx(20)
    assert measure_expert_return(store.create("cut", [episode(0.9, "cut", 3.0)], **names)) is None
    assert measure_expert_return(store.create("bare", drives(), **names)) is None


def test_one_is_the_return_of_the_expert_without_noise_on_its_actions() -> None:
    data = TrainingData.read(Store(DATASETS)["racetrack"], None)
    assert data.recorded_return is not None and data.expert_return is not None
    assert data.recorded_return == pytest.approx(19_541, abs=1)
    assert data.expert_return / data.recorded_return == pytest.approx(1.043, abs=0.001)
    rc = TrainingData.read(Store(DATASETS)["rc-lidar"], None)
    assert rc.expert_return == rc.recorded_return == 401  # it trembles and survives all the same


def test_fewer_labels_leave_the_experts_return_as_it_is(tmp_path: Path) -> None:
    shutil.copytree(DATASETS / "racetrack", tmp_path / "racetrack")
    fewer = limit_labels(Store(tmp_path), "racetrack", 100)
    assert TrainingData.read(fewer, None).expert_return == without_noise(19_540.81447875897)


def test_an_expert_that_nobody_drove_without_noise_counts_as_recorded(store: Store) -> None:
    labeled = drive(1, 10, score=0.5, labeled=True, ending="truncated")
    episode = replace(labeled, rewards=np.ones(10, np.float32))
    made = store.create("own", [episode], state_names=STATE_NAMES, action_names=ACTION_NAMES)
    data = TrainingData.read(made, None)
    assert data.expert_return == data.recorded_return == pytest.approx(20)
