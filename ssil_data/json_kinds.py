"""Values of several kinds as JSON objects that name their `kind`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, TypeVar

from ssil_data.errors import InvalidInputError

_Kind = TypeVar("_Kind")


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


def build(name: str, kinds: Mapping[str, type[_Kind]], json: Mapping[str, Any]) -> _Kind:
    """Build what a JSON object with its `kind` describes.

    Parameters
    ----------
    name
        What messages call it.
    kinds
        The types by their kinds.
    json
        The object.

    Raises
    ------
    InvalidInputError
        For an unknown kind, or values that do not fit.
    """
    values = dict(json)
    kind = values.pop("kind", None)
    if kind not in tuple(kinds):
        raise InvalidInputError(f"{name}: expected a kind of {sorted(kinds)}, found {kind!r}")
    try:
        return kinds[kind](**values)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name} {kind!r}: {error}") from None
