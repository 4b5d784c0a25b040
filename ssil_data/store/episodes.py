"""Checks and columns of the episodes table, shared by the store, the client and the service."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError, NotFoundError


def check_episode(dataset: str, episodes: pa.Table, number: int) -> None:
    """Refuse the number of an episode that a dataset does not have.

    Parameters
    ----------
    dataset
        The dataset's name, for the message.
    episodes
        Its episodes table.
    number
        The episode.

    Raises
    ------
    NotFoundError
        If no episode has the number.
    """
    if number not in episodes["episode"].to_pylist():
        raise NotFoundError(
            f"episode of {dataset}: expected 0 to {len(episodes) - 1}, found {number}"
        )


def check_labeled(dataset: str, episodes: pa.Table) -> None:
    """Refuse a dataset without a labeled episode.

    Parameters
    ----------
    dataset
        The dataset's name, for the message.
    episodes
        Its episodes table.

    Raises
    ------
    InvalidInputError
        If no episode is labeled.
    """
    if not any(episodes["labeled"].to_pylist()):
        raise InvalidInputError(
            f"labeled episodes of {dataset}: expected at least one, found none among "
            f"{len(episodes)}"
        )


def repeat_per_pair(episodes: pa.Table, column: str) -> NDArray[Any]:
    """Return a column of the episodes table for every pair (n,).

    Parameters
    ----------
    episodes
        The episodes table.
    column
        Its name, such as `labeled`.
    """
    return np.repeat(episodes[column].to_numpy(), episodes["length"].to_numpy())


def check_dimension_names(
    dataset: str,
    *,
    found: Mapping[str, Sequence[str]],
    expected: Mapping[str, Sequence[str]],
    quote: bool = True,
) -> None:
    """Refuse episodes whose dimensions are not the dataset's, in its order.

    Parameters
    ----------
    dataset
        The dataset's name, for the message.
    found
        The names of the episodes' dimensions, under the keys `state` and `action`.
    expected
        Those of the dataset.
    quote
        Whether the message says what was found; a service does not repeat what it is sent.

    Raises
    ------
    InvalidInputError
        For other names, or another order.

    Examples
    --------
    >>> from ssil_data.store.episodes import check_dimension_names
    >>> check_dimension_names("drives", found={"state": ["x", "y"]}, expected={"state": ["x", "y"]})
    """
    for kind, names in expected.items():
        if list(found[kind]) != list(names):
            rest = f", found {list(found[kind])}" if quote else " and in this order"
            raise InvalidInputError(
                f"{kind} of {dataset}: expected {list(names)} as in the dataset{rest}"
            )
