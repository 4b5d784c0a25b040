"""Choosing the labeled episodes of a file, by a column or by the episodes' values."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.interop.columns import Columns
from ssil_data.interop.episode_rows import EpisodeRows, format_value

_INTEGER = re.compile(r"-?[0-9]{1,20}")
_RANGE = re.compile(r"(-?[0-9]{1,20})-(-?[0-9]{1,20})")


def is_column(columns: Columns, chosen: Sequence[str]) -> bool:
    """Tell whether labeled episodes are chosen by a column of the file.

    Parameters
    ----------
    columns
        Columns of the file.
    chosen
        As for `find_labeled`.
    """
    return len(chosen) == 1 and chosen[0] in columns.names


def find_labeled(columns: Columns, chosen: Sequence[str], spans: EpisodeRows) -> NDArray[np.bool_]:
    """Tell which episodes are labeled.

    Parameters
    ----------
    columns
        Columns of the file.
    chosen
        Name of a column of true and false, or values of the episode column: `3`, `0-9`, `all`.
    spans
        The episodes of the file.

    Returns
    -------
    NDArray
        (e,), true for labeled.

    Raises
    ------
    InvalidInputError
        If the column has other values, or `chosen` names no episode.
    """
    if is_column(columns, chosen):
        values = columns.number_per_row(chosen[0], np.float64)
        other = np.flatnonzero(~np.isin(values, (0, 1)))
        if len(other):
            raise InvalidInputError(
                f"{columns.path}: expected true and false in {chosen[0]!r}, "
                f"found {format_value(values[other[0]])} at row {other[0]}"
            )
        return spans.one_per_episode(chosen[0], values).astype(bool)
    tokens = [part for text in chosen for part in text.split(",") if part]
    if chosen and not tokens:
        raise InvalidInputError(
            f"{columns.path}: --labeled {chosen[0]!r} names no episode; "
            "give a column, episodes such as 3 or 0-9, or all"
        )
    labeled = np.zeros(len(spans.values), bool)
    for token in tokens:
        labeled |= _match_episodes(columns, token, spans.values)
    return labeled


def _match_episodes(columns: Columns, token: str, values: Sequence[str]) -> NDArray[np.bool_]:
    """Tell which episodes a value, a range or "all" means."""
    if token == "all":
        return np.ones(len(values), bool)
    matching = np.array([value == token for value in values])
    ends = _RANGE.fullmatch(token)
    if not matching.any() and ends and all(end in values for end in ends.groups()):
        low, high = map(int, ends.groups())
        matching = np.array(
            [bool(_INTEGER.fullmatch(value)) and low <= int(value) <= high for value in values]
        )
    if not matching.any():
        shown = ", ".join(values[:6]) + (", …" if len(values) > 6 else "")
        raise InvalidInputError(
            f"{columns.path}: --labeled {token!r} names no episode; the episodes are "
            f"[{shown}], the columns {columns.names[:40]}"
        )
    return matching
