"""The table of methods: which pairs each imitates, and which state reward it adds."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardizer
from ssil_data.field import auto_alpha
from ssil_trainers.algorithms.config import TrainSettings
from ssil_trainers.algorithms.demonstrations import Demonstrations
from ssil_trainers.algorithms.expert_sampler import ExpertSampler
from ssil_trainers.algorithms.methods import METHODS, MethodName
from ssil_trainers.algorithms.policy import ActionBox
from support.toy_environment import demonstrations

BOX = ActionBox(np.full(1, -2, np.float32), np.full(1, 2, np.float32))


def test_the_names_for_the_command_line_are_those_of_the_table() -> None:
    assert get_args(MethodName) == tuple(METHODS)


def test_demonstrations_of_unequal_lengths_or_without_labels_are_refused() -> None:
    of = demonstrations()
    with pytest.raises(InvalidInputError, match="differ in length"):
        Demonstrations(of.states, of.actions[1:], of.labeled)
    with pytest.raises(InvalidInputError, match="labeled"):
        Demonstrations(of.states, of.actions, np.zeros(len(of.states), bool))


@pytest.mark.parametrize(
    ("method", "pairs"),
    [
        ("gail", 300),
        ("gail-mixed", 1500),
        ("mixgail", 300),
        ("ssil", 300),
        ("shuffled", 300),
        ("constant", 300),
        ("clone", 300),
        ("clone-mixed", 1500),
    ],
)
def test_experts_are_the_labeled_pairs_unless_all_are_imitated(method: str, pairs: int) -> None:
    of = demonstrations()
    experts = METHODS[method].expert_sampler(of, BOX, of.standardizer, settings=TrainSettings())
    assert isinstance(experts, ExpertSampler)
    assert len(experts.states) == pairs
    np.testing.assert_array_equal(experts.weights, np.ones(pairs))
    np.testing.assert_array_equal(experts.states, of.standardizer(of.states[:pairs]))
    np.testing.assert_allclose(experts.actions, np.clip(of.actions[:pairs], -2, 2) / 2, atol=1e-6)


def test_methods_differ_by_the_shaping() -> None:
    of = demonstrations()
    states = of.states[:7] + 0.1
    shaped = {name: METHODS[name].shaping(of, 0)(states) for name in METHODS}
    assert not shaped["gail"].any() and not shaped["constant"].any()
    np.testing.assert_array_equal(shaped["ssil"], of.field.lcor(states).values)
    np.testing.assert_array_equal(shaped["mixgail"], of.field.cor(states))
    mixed = of.field.lcor(states).values - shaped["shuffled"]
    assert np.abs(mixed).max() > 0.01


def test_shuffled_leverage_has_the_same_values_and_follows_the_seed() -> None:
    of = demonstrations()
    states = demonstrations().states[:50]
    one, again, other = (METHODS["shuffled"].shaping(of, seed)(states) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()
    mean = float(of.leverage.mean())
    assert one.mean() == pytest.approx(mean, abs=0.03)


def test_mixgail_without_a_run_fits_its_own_kernel() -> None:
    of = demonstrations()
    alone = METHODS["mixgail"].shaping(replace(of, leverage=None, field=None), 0)
    fitted = of.make_field(of.leverage, auto_alpha(of.standardizer(of.states)))
    np.testing.assert_array_equal(alone(of.states[:50]), fitted.cor(of.states[:50]))
    with_run = METHODS["mixgail"].shaping(of, 0)
    np.testing.assert_array_equal(with_run(of.states[:50]), of.field.cor(of.states[:50]))
    assert not METHODS["mixgail"].requires_run and METHODS["mixgail"].uses_run


@pytest.mark.parametrize("method", ["ssil", "shuffled", "clone-leverage", "gail-shuffled"])
def test_a_method_that_requires_a_run_is_refused_without_one(method: str) -> None:
    of = replace(demonstrations(), leverage=None, field=None)
    row = METHODS[method]
    assert row.requires_run
    with pytest.raises(InvalidInputError, match="run"):
        row.shaping(of, 0)
        row.expert_sampler(of, BOX, of.standardizer, settings=TrainSettings())


def test_states_are_standardized_by_all_demonstrations() -> None:
    of = demonstrations()
    expected = Standardizer.of(of.states)
    np.testing.assert_array_equal(of.standardizer.shift, expected.shift)
    np.testing.assert_array_equal(of.standardizer.scale, expected.scale)
