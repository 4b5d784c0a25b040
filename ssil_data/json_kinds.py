"""Values of several kinds as JSON objects that name their `kind`."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import MISSING, asdict, fields
from typing import Any, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError

_Kind = TypeVar("_Kind")


class _Short(reprlib.Repr):
    def repr_int(self, x: int, level: int) -> str:
        # Python refuses to write out more than 4,300 digits
        return repr(x) if x.bit_length() <= 64 else f"a whole number of {x.bit_length():,} bits"


_SHORT = _Short()
_SHORT.maxother = 80
_SHORT.maxstring = 80


def show_short(value: object) -> str:
    """Return what a message shows of a value that may be huge or deep.

    Parameters
    ----------
    value
        Any.
    """
    return _SHORT.repr(value)


def dump(value: Any) -> dict[str, Any]:
    """Return a dataclass that has a `kind` as a JSON object.

    Parameters
    ----------
    value
        Its fields are numbers, texts or tuples of them.
    """
    values = {
        name: list(field) if isinstance(field, tuple) else field
        for name, field in asdict(value).items()
    }
    return {"kind": value.kind, **values}


def shorten(values: NDArray[np.float32]) -> tuple[float, ...]:
    """Return float32 numbers as the shortest decimals that are read back as the same float32.

    Parameters
    ----------
    values
        Finite numbers, (n,).

    Examples
    --------
    >>> from ssil_data.json_kinds import shorten
    >>> shorten(np.array([0.1, 2.5], np.float32)), float(np.float32(0.1))
    ((0.1, 2.5), 0.10000000149011612)
    """
    short = np.array([float(str(value)) for value in values])
    same = short.astype(np.float32) == values
    return tuple(np.where(same, short, values.astype(np.float64)).tolist())


def to_python_number(value: Any) -> Any:
    """Return a number of NumPy as the int or float of Python that JSON has, anything else as it is.

    Parameters
    ----------
    value
        Any.

    Examples
    --------
    >>> from ssil_data.json_kinds import to_python_number
    >>> to_python_number(np.int64(3)), to_python_number(np.float32(0.5)), to_python_number("3")
    (3, 0.5, '3')
    """
    if isinstance(value, np.integer):
        return int(value)
    return float(value) if isinstance(value, np.floating) else value


def is_finite(value: object) -> bool:
    """Tell whether a value is a number, no truth value, that is finite as float64.

    Parameters
    ----------
    value
        Any.

    Examples
    --------
    >>> from ssil_data.json_kinds import is_finite
    >>> is_finite(2), is_finite(True), is_finite("2"), is_finite(10**400)
    (True, False, False, False)
    """
    number = to_python_number(value)
    if isinstance(number, bool) or not isinstance(number, int | float):
        return False
    try:
        return math.isfinite(number)
    except OverflowError:
        return False


def check_fields(name: str, value: Any) -> None:
    """Raise InvalidInputError unless all fields of a dataclass are numbers as they are declared.

    Numbers of NumPy are replaced by Python's, so that the fields are written as JSON.

    Parameters
    ----------
    name
        What messages call the dataclass.
    value
        Its fields are declared as whole numbers, numbers, or sequences of numbers.

    Examples
    --------
    >>> sd.Quantile(low=None)
    Traceback (most recent call last):
    ...
    ssil_data.errors.InvalidInputError: quantile: low: expected a finite number, found None
    """
    hints = get_type_hints(type(value))
    for field in fields(value):
        number = to_python_number(getattr(value, field.name))
        _check_value(f"{name}: {field.name}", number, hints[field.name])
        object.__setattr__(value, field.name, number)


def make_reader(
    name: str, kinds: Mapping[str, type[_Kind]]
) -> Callable[[Mapping[str, Any]], _Kind]:
    """Return the function that undoes `dump` for dataclasses of several kinds.

    It raises InvalidInputError for what is no JSON object, an unknown kind or key, a key that is
    missing, and values that do not fit.

    Parameters
    ----------
    name
        What messages call such a value.
    kinds
        Dataclasses by their kinds; their fields are numbers and sequences of numbers.
    """

    def read(json: Mapping[str, Any]) -> _Kind:
        kind, values = split_kind(name, kinds, json)
        chosen: Any = kinds[kind]
        hints = get_type_hints(chosen)
        for field in fields(chosen):
            label = f"{kind}: {field.name}"
            if field.name in values:
                _check_value(label, to_python_number(values[field.name]), hints[field.name])
            elif field.default is MISSING:
                raise InvalidInputError(f"{label}: missing in the {name}")
        return chosen(**values)

    return read


def split_kind(
    name: str, kinds: Mapping[str, type], json: Mapping[str, Any]
) -> tuple[str, dict[str, Any]]:
    """Return the kind that a JSON object names, and its other keys.

    Parameters
    ----------
    name
        What messages call the object.
    kinds
        Dataclasses by their kinds.
    json
        The object.

    Raises
    ------
    InvalidInputError
        For what is no JSON object, an unknown kind, or a key that is no field of the kind.
    """
    if not isinstance(json, Mapping):
        raise InvalidInputError(
            f"{name}: expected a JSON object with its kind, one of {sorted(kinds)}, "
            f"found {show_short(json)}"
        )
    values = dict(json)
    kind = values.pop("kind", None)
    if not isinstance(kind, str) or kind not in kinds:
        raise InvalidInputError(
            f"{name}: kind: expected one of {sorted(kinds)}, found {show_short(kind)}"
        )
    known = {field.name for field in fields(kinds[kind])}
    unknown = [key for key in values if key not in known]
    if unknown:
        raise InvalidInputError(
            f"{kind}: expected keys of {sorted(known)}, found {show_short(unknown)}"
        )
    return kind, values


def _check_value(name: str, value: Any, declared: Any) -> None:
    """Raise InvalidInputError unless a value is a number, or a list of numbers, as declared."""
    if value is None and declared == float | None:
        return
    if declared is int:
        expected = "a whole number below 2^63"
        fits = isinstance(value, int) and not isinstance(value, bool) and value.bit_length() < 64
    elif declared in (float, float | None):
        expected = "a finite number"
        fits = is_finite(value)
    else:
        expected = "a list of finite numbers"
        listed = value.tolist() if isinstance(value, np.ndarray) else value
        fits = isinstance(listed, list | tuple) and all(map(is_finite, listed))
    if not fits:
        raise InvalidInputError(f"{name}: expected {expected}, found {show_short(value)}")
