"""What is known about the demonstrations that a run learns from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ssil_data.demonstrations import Episode
from ssil_data.store import Store
from ssil_trainers.training.data import measure_expert_return
from support.demonstrations import ACTION_NAMES, STATE_NAMES, drive, drives


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
