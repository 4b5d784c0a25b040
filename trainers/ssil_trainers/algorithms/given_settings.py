"""Which settings a caller chose, so that neither a preset nor a method replaces one in silence."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Literal

from ssil_data.errors import InvalidInputError
from ssil_trainers.algorithms.config import PAPER, TrainSettings

PresetName = Literal["default", "paper"]
"""The presets of training, for the types of the command line."""


@dataclass(frozen=True, init=False)
class GivenSettings(TrainSettings):
    """Settings of a command line, which remember the options that were given.

    An option that is given its default value is one too, which the value does not tell.

    Parameters
    ----------
    **given:
        Some of the settings.

    Examples
    --------
    >>> settings = GivenSettings(kl=0.01)
    >>> settings == GivenSettings(), list_given(settings)
    (True, ['kl'])
    """

    def __init__(self, **given: Any) -> None:
        """Make the settings, with the defaults of those that are not given."""
        super().__init__(**given)
        object.__setattr__(self, "_given", tuple(given))

    def forget(self) -> TrainSettings:
        """Return the settings alone, for `dataclasses.replace`, which names every one of them."""
        return TrainSettings(**{field.name: getattr(self, field.name) for field in fields(self)})


def list_given(settings: TrainSettings) -> list[str]:
    """Return the names of the settings that were given: by value, those that are not the default.

    Parameters
    ----------
    settings:
        Settings of a command line, or any.

    Examples
    --------
    >>> list_given(TrainSettings(kl=0.02, seed=0))
    ['kl']
    """
    if isinstance(settings, GivenSettings):
        return list(settings.__dict__["_given"])
    usual = TrainSettings()
    names = [field.name for field in fields(TrainSettings)]
    return [name for name in names if getattr(settings, name) != getattr(usual, name)]


def apply_preset(preset: PresetName, settings: TrainSettings, *, prefix: str = "") -> TrainSettings:
    """Return the settings with the preset's in their place.

    Parameters
    ----------
    preset:
        `paper` has those of `PAPER`, `default` none.
    settings:
        Settings as they were given.
    prefix:
        How the options of the settings begin, if not with their names.

    Raises
    ------
    InvalidInputError
        If a setting was given that the preset has another value of; the message names all.

    Examples
    --------
    >>> apply_preset("paper", TrainSettings(kl=0.02)).gae_lambda
    0.0
    >>> apply_preset("paper", TrainSettings(gae_lambda=0.5))
    Traceback (most recent call last):
    ssil_data.errors.InvalidInputError: --preset paper: has --gae-lambda 0.0; leave out ...
    """
    plain = settings.forget() if isinstance(settings, GivenSettings) else settings
    if preset == "default":
        return plain
    given = list_given(settings)
    other = [name for name in PAPER if name in given and getattr(settings, name) != PAPER[name]]
    if other:
        theirs = ", ".join(_show_option(prefix + name, PAPER[name]) for name in other)
        ours = [_show_option(prefix + name, getattr(settings, name)) for name in other]
        raise InvalidInputError(
            f"--preset paper: has {theirs}; leave out {' and '.join(ours)}, or the preset"
        )
    return replace(plain, **PAPER)


def name_option(name: str, value: object) -> str:
    """Return the option that sets a setting to a value, without the value.

    Parameters
    ----------
    name:
        Name of the setting.
    value:
        Its value: that of a switch which is off is part of the option's name.

    Examples
    --------
    >>> name_option("gae_lambda", 0.5), name_option("centered", False)
    ('--gae-lambda', '--no-centered')
    """
    parent, dot, own = name.replace("_", "-").rpartition(".")
    return f"--{parent}{dot}{'no-' if value is False else ''}{own}"


def _show_option(name: str, value: object) -> str:
    """Return how a setting is given on a command line."""
    option = name_option(name, value)
    return option if isinstance(value, bool) else f"{option} {value}"
