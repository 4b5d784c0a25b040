"""What the parts of a recipe must be."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TypeVar

from ssil_data.errors import InvalidInputError
from ssil_data.json_kinds import is_finite, show_short, to_python_number

_Kind = TypeVar("_Kind")


def check_part(name: str, value: object, expected: type, example: str) -> None:
    """Raise InvalidInputError for a part of another type, such as the name of its kind.

    Parameters
    ----------
    name
        What the message calls it.
    value
        The part.
    expected
        Its type.
    example
        How one is made.
    """
    if not isinstance(value, expected):
        raise InvalidInputError(
            f"{name}: expected {expected.__name__.lower()} settings such as {example}, "
            f"found {show_short(value)}"
        )


def check_choice(name: str, value: object, choices: Collection[str]) -> None:
    """Raise InvalidInputError for what is none of the choices.

    Parameters
    ----------
    name
        What the message calls it.
    value
        What was chosen.
    choices
        What there is.
    """
    if not isinstance(value, str) or value not in choices:
        raise InvalidInputError(
            f"{name}: expected one of {sorted(choices)}, found {show_short(value)}"
        )


def make_default(name: str, kind: object, kinds: Mapping[str, type[_Kind]]) -> _Kind:
    """Return default settings of a kind; raise InvalidInputError for what is none.

    Parameters
    ----------
    name
        What the message calls it.
    kind
        The kind.
    kinds
        Settings by their kinds.
    """
    check_choice(name, kind, kinds)
    return kinds[str(kind)]()


def check_switch(name: str, value: object) -> None:
    """Raise InvalidInputError for what is neither true nor false.

    Parameters
    ----------
    name
        What the message calls it.
    value
        The switch.
    """
    if not isinstance(value, bool):
        raise InvalidInputError(f"{name}: expected true or false, found {show_short(value)}")


def check_floor(name: str, value: float) -> None:
    """Raise InvalidInputError for what is no finite number of 0 or more.

    Parameters
    ----------
    name
        What the message calls it.
    value
        The floor.
    """
    if isinstance(value, bool) or not isinstance(to_python_number(value), int | float):
        raise InvalidInputError(f"{name}: expected a number, found {show_short(value)}")
    if not is_finite(value) or value < 0:
        raise InvalidInputError(f"{name}: expected 0 or more, found {show_short(value)}")
