"""Counts among settings: whole numbers, checked once, where they are given."""

from __future__ import annotations

import numpy as np

from ssil_data.errors import InvalidInputError


def count(name: str, value: object, *, least: int = 1) -> int:
    """Return a count of at least `least`; raises InvalidInputError that names it.

    A float is refused even if it is whole: it was meant for something else.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InvalidInputError(f"{name}: expected a whole number, found {value!r}")
    if value < least:
        raise InvalidInputError(f"{name}: expected at least {least}, found {value}")
    return int(value)
