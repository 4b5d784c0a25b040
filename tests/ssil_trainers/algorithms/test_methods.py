"""The table of methods: which pairs each imitates, and which state reward it adds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest

from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardizer
from ssil_trainers.algorithms.config import PAPER, TrainSettings
from ssil_trainers.algorithms.cor_sharpness import EVEN, auto_cor_alpha
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


def test_lists_of_numbers_become_arrays() -> None:
    wanted: dict[str, Any] = {
        "states": [[0.0, 1.0], [2.0, 3.0]],
        "actions": [[1.0], [2.0]],
        "labeled": [True, False],
        "leverage": [1.0, 0.25],
    }
    of = Demonstrations(**wanted)
    for name, values in wanted.items():
        found = getattr(of, name)
        assert found.dtype == (bool if name == "labeled" else np.float32)
        assert found.tolist() == values
    for leverage, message in (
        ([1.0, 1.5], "expected numbers from 0 to 1, found 1.5 at row 1"),
        ([1.0], "expected one number per pair, 2, found shape"),
        (0.5, "expected one number per pair, 2, found shape"),
        ([1.0, "much"], "expected an array of numbers"),
        ([1.0, [0.5]], "expected an array of numbers"),
    ):
        with pytest.raises(InvalidInputError, match=f"^leverage: {message}"):
            Demonstrations(**{**wanted, "leverage": leverage})


@pytest.mark.parametrize("wrong", [np.nan, -0.1, 1.1, np.inf])
def test_leverage_that_is_no_number_from_0_to_1_per_pair_is_refused(wrong: float) -> None:
    of = demonstrations()
    assert of.leverage is not None
    leverage = of.leverage.copy()
    leverage[7] = wrong
    with pytest.raises(InvalidInputError, match=r"leverage: .* from 0 to 1, found .* at row 7"):
        replace(of, leverage=leverage)
    with pytest.raises(InvalidInputError, match="leverage: expected one number per pair, 1500"):
        replace(of, leverage=of.leverage[1:])


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
    settings = TrainSettings(cor_alpha=3.0)
    shaped = {name: METHODS[name].shaping(of, settings)(states) for name in METHODS}
    assert not shaped["gail"].any() and not shaped["constant"].any()
    np.testing.assert_array_equal(shaped["ssil"], of.field.lcor(states).values)
    np.testing.assert_array_equal(shaped["mixgail"], of.field.at(3.0).cor(states))
    mixed = of.field.lcor(states).values - shaped["shuffled"]
    assert np.abs(mixed).max() > 0.01


def test_shuffled_leverage_has_the_same_values_and_follows_the_seed() -> None:
    of = demonstrations()
    states = demonstrations().states[:50]
    one, again, other = (
        METHODS["shuffled"].shaping(of, TrainSettings(seed=seed))(states) for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()
    mean = float(of.leverage.mean())
    assert one.mean() == pytest.approx(mean, abs=0.03)


def test_mixgail_fits_its_own_kernel_whatever_that_of_a_run_is() -> None:
    of = demonstrations()
    row = METHODS["mixgail"]
    alpha = auto_cor_alpha(of.standardizer(of.states), of.labeled)
    assert alpha != of.field.alpha
    for settings in (TrainSettings(), TrainSettings(**PAPER)):
        alone = row.shaping(replace(of, leverage=None, field=None), settings)
        expected = of.field.at(alpha).cor(of.states[:50])
        np.testing.assert_allclose(alone(of.states[:50]), expected, rtol=1e-12)
        np.testing.assert_array_equal(row.shaping(of, settings)(of.states[:50]), expected)
        assert row.complete(settings, of).cor_alpha == alpha
    assert METHODS["ssil"].complete(TrainSettings(), of).cor_alpha == "auto"
    assert not row.requires_run and row.uses_run


def test_the_sharpness_of_cor_spreads_it_as_evenly_as_any() -> None:
    """Two groups: far apart a flat kernel tells them apart too well, close together none does."""
    labeled = np.arange(400) < 200
    for apart in (0.05, 1.0, 30.0):
        states = np.linspace(0, 1, 400, dtype=np.float32)[:, None] + apart * labeled[:, None]
        alpha = auto_cor_alpha(states, labeled)
        field = Demonstrations(states, states, labeled).make_field(np.ones(400, np.float32), alpha)
        raw = replace(field, standardizer=Standardizer(np.zeros(1), np.ones(1)))
        away = abs(raw.cor(states).std() - EVEN)
        for other in (0.01, 0.1, 1.0, 10.0, 100.0, 10_000.0):
            assert away <= abs(raw.at(other).cor(states).std() - EVEN) + 1e-12


@pytest.mark.parametrize("labeled", [True, False])
def test_cor_is_refused_where_all_states_are_labeled_or_none(labeled: bool) -> None:
    with pytest.raises(InvalidInputError, match="CoR: expected labeled and unlabeled states"):
        auto_cor_alpha(np.zeros((3, 1), np.float32), np.full(3, labeled))


@pytest.mark.parametrize("alpha", [0.0, -1.0, np.nan, np.inf, "sharp"])
def test_a_sharpness_that_is_none_is_refused(alpha: float) -> None:
    with pytest.raises(InvalidInputError, match="cor_alpha: expected auto or a number from 1e-06"):
        TrainSettings(cor_alpha=alpha)


@pytest.mark.parametrize("method", ["ssil", "shuffled", "clone-leverage", "gail-shuffled"])
def test_a_method_that_requires_a_run_is_refused_without_one(method: str) -> None:
    of = replace(demonstrations(), leverage=None, field=None)
    row = METHODS[method]
    assert row.requires_run
    with pytest.raises(InvalidInputError, match="run"):
        row.shaping(of, TrainSettings())
        row.expert_sampler(of, BOX, of.standardizer, settings=TrainSettings())


def test_states_are_standardized_by_all_demonstrations() -> None:
    of = demonstrations()
    expected = Standardizer.of(of.states)
    np.testing.assert_array_equal(of.standardizer.shift, expected.shift)
    np.testing.assert_array_equal(of.standardizer.scale, expected.scale)
