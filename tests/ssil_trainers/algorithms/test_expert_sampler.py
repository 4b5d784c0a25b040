"""Expert pairs are drawn by their weights."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ssil_data.errors import InvalidInputError
from ssil_trainers.algorithms.expert_sampler import ExpertSampler


def numbered(weight: list[float]) -> ExpertSampler:
    """Experts whose state is their number."""
    column = np.arange(len(weight), dtype=np.float32)[:, None]
    return ExpertSampler(column, -column, np.array(weight, np.float32))


def test_pairs_are_drawn_by_their_weight_and_stay_together() -> None:
    states, actions = numbered([0, 1, 3, 0]).sample(4000, np.random.default_rng(0))
    assert torch.equal(states, -actions)
    assert set(states.ravel().tolist()) == {1, 2}
    assert float((states == 2).float().mean()) == pytest.approx(0.75, abs=0.03)


@pytest.mark.parametrize("weight", [[0.0, 0.0], [1.0, -0.1]])
def test_all_zero_and_negative_weights_are_refused(weight: list[float]) -> None:
    with pytest.raises(InvalidInputError, match="weights"):
        numbered(weight)


def test_unequal_lengths_are_refused() -> None:
    with pytest.raises(InvalidInputError, match="differ in length"):
        ExpertSampler(np.zeros((2, 1)), np.zeros((3, 1)), np.ones(2))
