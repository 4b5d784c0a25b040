"""Settings that were given and that a method does not use, which a command refuses.

In Python one set of settings may serve several methods, each of which takes what it uses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from ssil_data.errors import InvalidInputError
from ssil_trainers.algorithms.config import PAPER, TrainSettings
from ssil_trainers.algorithms.given_settings import (
    GivenSettings,
    PresetName,
    list_given,
    name_option,
)
from ssil_trainers.algorithms.methods import METHODS, Method, MethodName
from ssil_trainers.algorithms.rewards import no_shaping, shape_by_cor, shape_by_lcor

FOR_ALL = frozenset(
    {
        "seed",
        "steps",
        "environments",
        "horizon",
        "hidden",
        "log_sigma",
        "cloning_steps",
        "boundary",
        "evaluate_every",
        "evaluations",
    }
)
"""Settings that every method takes: what a run may cost is the same for all that are compared, also
where one of them needs less."""

_CLONING = ("cloning_batch", "cloning_rate", "cloning_weight_decay")
_LOOP = (
    "discount",
    "gae_lambda",
    "kl",
    "damping",
    "conjugate_steps",
    "fisher_share",
    "entropy",
    "critic_epochs",
    "critic_batch",
    "critic_rate",
)
_DISCRIMINATOR = (
    "discriminator_steps",
    "discriminator_batch",
    "discriminator_rate",
    "gradient_penalty",
    "spectral_norm",
)
_STATE_REWARD = ("eta", "eta_decay", "centered")


def _has_loop(method: Method) -> bool:
    return method.fixed_settings.get("steps") != 0


def _has_discriminator(method: Method) -> bool:
    return _has_loop(method) and method.fixed_settings.get("discriminator_steps") != 0


USERS: Mapping[str, Callable[[Method], bool]] = MappingProxyType(
    {
        "pretrained": lambda method: "pretrained" not in method.fixed_settings,
        **dict.fromkeys(_CLONING, lambda method: True),
        **dict.fromkeys(_LOOP, _has_loop),
        **dict.fromkeys(_DISCRIMINATOR, _has_discriminator),
        **dict.fromkeys(_STATE_REWARD, lambda method: method.shaping is not no_shaping),
        "cor_alpha": lambda method: method.shaping is shape_by_cor,
        "pair_reward": lambda method: method.shaping is shape_by_lcor,
        "expert_weighting": lambda method: method.half_labeled,
        "odds_limit": lambda method: method.half_labeled or method.shaping is shape_by_lcor,
    }
)
"""Which methods use a setting, for all settings that some do not."""


def check_used(
    method: MethodName, settings: TrainSettings, *, stored: Mapping[str, Any] | None = None
) -> None:
    """Raise InvalidInputError for settings that were given, change nothing and say that they would.

    A default is no such setting, unless the method has another value of its own.

    Parameters
    ----------
    method:
        Name of the method.
    settings:
        Settings as they were given, before a preset or the method changes them.
    stored:
        Settings of the run that is resumed, which may be given again: version 0.1 refused none.

    Raises
    ------
    InvalidInputError
        If there are any: the message names each option and who uses it.

    Examples
    --------
    >>> check_used("mixgail", TrainSettings(cor_alpha=3.0))
    >>> check_used("gail", TrainSettings(cor_alpha=3.0))
    Traceback (most recent call last):
    ssil_data.errors.InvalidInputError: --cor-alpha: used by mixgail, not by gail
    >>> check_used("gail", TrainSettings(cor_alpha=3.0), stored={"cor_alpha": 3.0})
    """
    usual = TrainSettings()
    own = METHODS[method].fixed_settings
    unused = []
    for name, is_used_by in USERS.items():
        value = getattr(settings, name)
        if name not in list_given(settings) or value == own.get(name, getattr(usual, name)):
            continue
        if stored is not None and name in stored and stored[name] == value:
            continue
        flag = name_option(name, value)
        if not is_used_by(METHODS[method]):
            users = ", ".join(other for other, row in METHODS.items() if is_used_by(row))
            unused.append(f"{flag}: used by {users}, not by {method}")
        elif missing := _find_missing(name, METHODS[method], settings):
            unused.append(f"{flag}: used by {method} only with {missing}")
    if unused:
        raise InvalidInputError("; ".join(unused))


def leave_out_replaced(
    method: MethodName,
    preset: PresetName,
    settings: TrainSettings,
    stored: Mapping[str, Any],
) -> TrainSettings:
    """Return the settings of a run that goes on, without those that it was begun in spite of.

    Version 0.1 took options that the method or the preset has its own value of, and trained and
    stored that value. Such a run goes on with the command line that it was begun with.

    Parameters
    ----------
    method:
        Name of the method.
    preset:
        Name of the preset.
    settings:
        Settings as they were given.
    stored:
        Settings of the run that is resumed.

    Examples
    --------
    >>> given = TrainSettings(gae_lambda=0.5, kl=0.02)
    >>> list_given(leave_out_replaced("gail", "paper", given, {"gae_lambda": 0.0}))
    ['kl']
    """
    own = {**(PAPER if preset == "paper" else {}), **METHODS[method].fixed_settings}
    replaced = {name for name, value in own.items() if name in stored and stored[name] == value}
    kept = [name for name in list_given(settings) if name not in replaced]
    return GivenSettings(**{name: getattr(settings, name) for name in kept})


def _find_missing(name: str, method: Method, settings: TrainSettings) -> str:
    """Return which other option a setting has no effect without; an empty text for none."""
    if name in _CLONING:
        return "" if method.override(settings).pretrained else "--pretrained"
    if name != "odds_limit":
        return ""
    with_ratio = method.half_labeled and settings.expert_weighting == "ratio"
    with_reward = method.shaping is shape_by_lcor and settings.pair_reward > 0
    if with_ratio or with_reward:
        return ""
    options = {
        "--expert-weighting ratio": method.half_labeled,
        "--pair-reward": method.shaping is shape_by_lcor,
    }
    return " or ".join(option for option, helps in options.items() if helps)
