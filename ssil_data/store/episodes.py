"""What follows from the episodes table alone: the same for the store, the client and the service."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError, NotFoundError


def check_episode(dataset: str, episodes: pa.Table, number: int) -> None:
    """Refuse the number of an episode that a dataset does not have.

    Parameters
    ----------
    dataset:
        The dataset's name, for the message.
    episodes:
        Its episodes table.
    number:
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
    dataset:
        The dataset's name, for the message.
    episodes:
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
    episodes:
        The episodes table.
    column:
        Its name, such as `labeled`.
    """
    return np.repeat(episodes[column].to_numpy(), episodes["length"].to_numpy())
