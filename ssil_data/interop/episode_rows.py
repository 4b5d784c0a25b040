"""Which rows of a file belong to which episode."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.interop.columns import Columns

_EXACT = 2**53
"""From here on, float64 cannot tell neighboring integers apart."""


class EpisodeRows:
    """The episodes of a file: runs of adjacent rows with one value of the episode column.

    `rows[i]` is the slice of episode i and `values[i]` its value, as text.

    Parameters
    ----------
    columns
        Columns of the file.
    name
        Name of the episode column; without one, the file is one episode.
    count
        Rows of the file.

    Raises
    ------
    InvalidInputError
        If the rows of an episode are not adjacent, or a value is neither an integer nor text.
    """

    def __init__(self, columns: Columns, name: str | None, count: int) -> None:
        self.path = columns.path
        column = np.zeros(count, int) if name is None else columns.one_per_row(name)
        if column.dtype.kind == "f":
            vague = np.flatnonzero(~(np.abs(column) < _EXACT))
            if len(vague):
                raise InvalidInputError(
                    f"{columns.path}: expected integers or text in {name!r}, "
                    f"found {column[vague[0]]} at row {vague[0]}"
                )
        starts = np.flatnonzero(np.r_[True, column[1:] != column[:-1]])
        self._starts = starts
        self.rows = [
            slice(int(a), int(b)) for a, b in zip(starts, [*starts[1:], count], strict=True)
        ]
        self.values = [format_value(column[start]) for start in starts]
        seen: set[str] = set()
        for value, rows in zip(self.values, self.rows, strict=True):
            if value in seen:
                raise InvalidInputError(
                    f"{columns.path}: episode {value} begins again at row {rows.start}; "
                    "the rows of an episode must be adjacent"
                )
            seen.add(value)

    def episode_at(self, row: int) -> str:
        """Return the value of the episode that a row belongs to.

        Parameters
        ----------
        row
            Row of the file, from 0.
        """
        return self.values[int(np.searchsorted(self._starts, row, side="right")) - 1]

    def within_episodes(self, differs: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Return the rows that differ from the row before them in the same episode.

        Parameters
        ----------
        differs
            Whether each row from the second on differs from the one before, (n − 1,).
        """
        return np.setdiff1d(np.flatnonzero(differs) + 1, self._starts)

    def changes(self, column: NDArray[Any]) -> NDArray[np.intp]:
        """Return the rows where a column changes within an episode.

        Parameters
        ----------
        column
            Values (n,).
        """
        return self.within_episodes(column[1:] != column[:-1])

    def one_per_episode(self, name: str, column: NDArray[Any]) -> NDArray[Any]:
        """Return a column's value for each episode.

        Parameters
        ----------
        name
            Name of the column, for messages.
        column
            Values (n,).

        Raises
        ------
        InvalidInputError
            If it changes within an episode; it names the row.
        """
        changes = self.changes(column)
        if len(changes):
            row = int(changes[0])
            raise InvalidInputError(
                f"{self.path}: {name} changes at row {row}, within episode "
                f"{self.episode_at(row)}; an episode has one value of it"
            )
        return column[self._starts]


def format_value(value: Any) -> str:
    """Return a value as text; 3.0 is the integer 3.

    Parameters
    ----------
    value
        A number or text.
    """
    if isinstance(value, (float, np.floating)) and float(value).is_integer():
        return str(int(value))
    return str(value)
