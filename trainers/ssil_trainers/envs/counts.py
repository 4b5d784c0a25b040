"""Counts among settings: whole numbers, checked once, where they are given."""

from __future__ import annotations

import numpy as np

from ssil_data.errors import InvalidInputError


def check_count(name: str, value: object, *, least: int = 1) -> int:
    """Return a setting that counts something as an int.

    A float is refused even if it is whole: it was meant for something else.

    Parameters
    ----------
    name:
        Name of the setting, for the message.
    value:
        What the caller gave.
    least:
        Smallest count that is accepted.

    Returns
    -------
    int
        The count.

    Raises
    ------
    InvalidInputError
        If it is no whole number or below `least`.

    Examples
    --------
    >>> from ssil_trainers.envs.counts import check_count
    >>> check_count("runs", np.int64(6))
    6
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InvalidInputError(f"{name}: expected a whole number, found {value!r}")
    if value < least:
        raise InvalidInputError(f"{name}: expected at least {least}, found {value}")
    return int(value)
