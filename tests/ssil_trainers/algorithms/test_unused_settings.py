"""What a method does not use is refused, and all that is refused would have changed nothing.

So is what a preset or a method would replace.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, get_args

import gymnasium
import numpy as np
import pytest

from ssil_data.errors import InvalidInputError
from ssil_trainers.algorithms.config import PAPER, TrainSettings
from ssil_trainers.algorithms.demonstrations import Demonstrations
from ssil_trainers.algorithms.given_settings import GivenSettings, apply_preset, list_given
from ssil_trainers.algorithms.methods import METHODS, MethodName
from ssil_trainers.algorithms.policy import Policy
from ssil_trainers.algorithms.unused_settings import FOR_ALL, USERS, check_used
from ssil_trainers.training.data import TrainingData
from ssil_trainers.training.run import train

SHORT = TrainSettings(
    steps=64, environments=2, horizon=16, hidden=8, evaluations=1, cloning_steps=5
)

CHANGED: dict[str, Any] = {
    "discount": 0.9,
    "gae_lambda": 0.5,
    "kl": 0.02,
    "damping": 0.2,
    "conjugate_steps": 3,
    "fisher_share": 0.5,
    "entropy": 0.1,
    "critic_epochs": 2,
    "critic_batch": 16,
    "critic_rate": 1e-2,
    "discriminator_steps": 3,
    "discriminator_batch": 16,
    "discriminator_rate": 1e-2,
    "gradient_penalty": 1.0,
    "spectral_norm": True,
    "eta": 3.0,
    "eta_decay": 0.5,
    "centered": False,
    "cor_alpha": 3.0,
    "pair_reward": 0.5,
    "expert_weighting": "ratio",
    "odds_limit": 3.0,
    "pretrained": True,
    "cloning_batch": 16,
    "cloning_rate": 1e-2,
    "cloning_weight_decay": 1.0,
}
"""Another value of every setting that some method does not use."""


def is_refused(method: MethodName, settings: TrainSettings) -> bool:
    try:
        check_used(method, settings)
    except InvalidInputError:
        return True
    return False


def learn(method: str, settings: TrainSettings) -> Policy:
    rng = np.random.default_rng(0)
    states = rng.normal(size=(60, 3)).astype(np.float32)
    actions = rng.uniform(-2, 2, (60, 1)).astype(np.float32)
    labeled = np.arange(60) < 20
    leverage = rng.random(60).astype(np.float32)
    pairs = Demonstrations(states, actions, labeled, leverage)
    field = pairs.make_field(leverage, alpha=1.0)
    pairs = Demonstrations(states, actions, labeled, leverage, field)
    mode = {"autoreset_mode": gymnasium.vector.AutoresetMode.SAME_STEP}
    return train(
        method,
        TrainingData(pairs),
        lambda count: gymnasium.make_vec("Pendulum-v1", count, vector_kwargs=mode),
        settings=settings,
    ).policy


def test_every_setting_is_for_all_methods_or_says_for_which() -> None:
    assert {*FOR_ALL, *USERS} == {field.name for field in fields(TrainSettings)}
    assert not FOR_ALL & set(USERS)
    assert set(CHANGED) == set(USERS)


@pytest.mark.parametrize("method", get_args(MethodName))
def test_what_is_refused_would_have_changed_nothing(method: MethodName) -> None:
    unused = {
        name: value
        for name, value in CHANGED.items()
        if is_refused(method, replace(SHORT, **{name: value}))
    }
    assert "cor_alpha" in unused or method == "mixgail"
    usual, changed = (learn(method, each) for each in (SHORT, replace(SHORT, **unused)))
    for ours, theirs in zip(usual.layers, changed.layers, strict=True):
        assert all((a == b).all() for a, b in zip(ours, theirs, strict=True))
    assert (usual.log_sigma == changed.log_sigma).all()


@pytest.mark.parametrize(
    ("method", "name"),
    [
        ("gail", "kl"),
        ("gail", "gradient_penalty"),
        ("constant", "entropy"),
        ("mixgail", "eta"),
        ("mixgail", "cor_alpha"),
        ("ssil", "centered"),
        ("shuffled", "eta"),
        ("gail-leverage", "expert_weighting"),
        ("clone-shuffled", "expert_weighting"),
        ("clone", "cloning_rate"),
    ],
)
def test_what_is_used_is_taken_and_changes_the_policy(method: MethodName, name: str) -> None:
    settings = replace(SHORT, **{name: CHANGED[name]})
    check_used(method, settings)
    usual, changed = (learn(method, each) for each in (SHORT, settings))
    assert any((a != b).any() for a, b in zip(usual.layers[0], changed.layers[0], strict=True))


def test_an_option_that_needs_another_is_taken_with_it() -> None:
    odds = replace(SHORT, odds_limit=3.0)
    for method in ("ssil", "ssil-leverage"):
        assert is_refused(method, odds)
        check_used(method, replace(odds, pair_reward=0.5))
    for method in ("gail-leverage", "ssil-leverage", "clone-shuffled"):
        assert is_refused(method, odds)
        check_used(method, replace(odds, expert_weighting="ratio"))
    decay = replace(SHORT, cloning_weight_decay=1.0)
    assert is_refused("ssil", decay)
    check_used("ssil", replace(decay, pretrained=True))
    check_used("clone-mixed", decay)


def test_the_methods_own_value_is_taken() -> None:
    check_used("constant", replace(SHORT, discriminator_steps=0))
    check_used("clone", replace(SHORT, pretrained=True))


@pytest.mark.parametrize("method", get_args(MethodName))
def test_whatever_the_method_replaces_is_refused_even_if_it_is_the_default(
    method: MethodName,
) -> None:
    """But for the number of steps, which says what a run may cost."""
    own = METHODS[method].fixed_settings
    for name, value in own.items():
        usual = getattr(TrainSettings(), name)
        check_used(method, GivenSettings(**{name: value}))
        assert is_refused(method, GivenSettings(**{name: usual})) == (
            name in USERS and usual != value
        )
    for name in USERS.keys() - own.keys():
        check_used(method, GivenSettings(**{name: getattr(TrainSettings(), name)}))


def test_a_resumed_run_may_be_given_again_what_it_was_given() -> None:
    given = GivenSettings(eta=3.0, pair_reward=0.5)
    check_used("gail", given, stored={"eta": 3.0, "pair_reward": 0.5})
    with pytest.raises(InvalidInputError, match=r"^--pair-reward: used by ssil[^;]*$"):
        check_used("gail", given, stored={"eta": 3.0, "pair_reward": 0.0})
    with pytest.raises(InvalidInputError, match=r"^--pair-reward: used by ssil[^;]*$"):
        check_used("gail", given, stored={"eta": 3.0})


def test_given_settings_are_the_same_settings_and_know_what_was_given() -> None:
    given = GivenSettings(kl=0.01, seed=3)
    assert list_given(given) == ["kl", "seed"]
    assert list_given(TrainSettings(kl=0.01, seed=3)) == ["seed"]
    assert given.forget() == TrainSettings(seed=3)
    assert type(given.forget()) is TrainSettings
    with pytest.raises(InvalidInputError, match="kl: expected a number above 0"):
        GivenSettings(kl=0)


@pytest.mark.parametrize("name", PAPER)
def test_the_preset_paper_takes_its_own_value_and_refuses_any_other(name: str) -> None:
    own = PAPER[name]
    paper = TrainSettings(**PAPER)
    assert apply_preset("paper", GivenSettings(**{name: own})) == paper
    for other in {CHANGED[name], getattr(TrainSettings(), name)} - {own}:
        given = GivenSettings(**{name: other})
        assert getattr(apply_preset("default", given), name) == other
        with pytest.raises(InvalidInputError, match=name.replace("_", "-")):
            apply_preset("paper", given)


def test_the_message_names_every_option_and_who_uses_it() -> None:
    with pytest.raises(InvalidInputError) as refused:
        check_used("gail", replace(SHORT, pair_reward=0.5, centered=False))
    assert str(refused.value) == (
        "--no-centered: used by mixgail, ssil, ssil-leverage, shuffled, not by gail; "
        "--pair-reward: used by ssil, ssil-leverage, not by gail"
    )
