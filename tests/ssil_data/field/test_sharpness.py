"""The sharpness that makes a value rest on a share of the store."""

import numpy as np
import pytest

from ssil_data.features import Standardizer
from ssil_data.field import LeverageField, auto_alpha
from ssil_data.field.sharpness import ALPHA_RANGE


@pytest.mark.parametrize("share", [0.05, 0.1, 0.5])
def test_auto_alpha_makes_an_answer_rest_on_the_wanted_share_of_the_store(share: float):
    made_states = np.random.default_rng(15).normal(size=(5200, 29)).astype(np.float32)
    queries = made_states[:200]
    states = made_states[200:]
    field = LeverageField(
        states,
        np.ones(5000, np.float32),
        np.ones(5000, bool),
        Standardizer.of(states),
        auto_alpha(Standardizer.of(states)(states), share=share),
    )
    sizes = field.lcor(queries).effective_sample_size
    assert sizes.mean() / 5000 == pytest.approx(share, rel=0.2)


@pytest.mark.parametrize(("share", "is_odd"), [(0.1, True), (0.6, False)])
def test_auto_alpha_is_odd_where_that_changes_little(share: float, is_odd: bool):
    rng = np.random.default_rng(16)
    states = rng.normal(size=(3000, 1)) + rng.normal(size=(3000, 100)) * 0.3
    alpha = auto_alpha(states.astype(np.float32), share=share)  # near 37 and near 2
    assert (alpha % 2 == 1) == is_odd


def test_auto_alpha_stops_at_its_ends():
    same = np.zeros((100, 3), np.float32)
    assert auto_alpha(same) == pytest.approx(ALPHA_RANGE[1], rel=1e-3)
    assert auto_alpha(np.zeros((1, 3), np.float32)) > 0
