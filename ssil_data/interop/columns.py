"""The named columns of a file, each checked when it is used."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ssil_data.errors import InvalidInputError, NotFoundError

SCALAR = "a scalar"
"""What `Columns.unreadable` says of an array without rows."""


@dataclass(frozen=True)
class Unreadable:
    """A column that is neither numbers nor text nor times; `found` says what it is."""

    found: str


class Columns(Mapping[str, NDArray[Any]]):
    """The columns of one file by name: (n,) or (n, w) arrays of numbers, text or times.

    A column that cannot be read is not among them, but `columns[name]` raises an error that says
    why; `unreadable` has its name with what it is.

    Parameters
    ----------
    path
        The file, for messages.
    columns
        Names with what was read.

    Raises
    ------
    InvalidInputError
        If there are no columns or no rows, or two columns have one name.
    """

    def __init__(
        self, path: Path, columns: Iterable[tuple[str, NDArray[Any] | Unreadable]]
    ) -> None:
        self.path = path
        self._arrays: dict[str, NDArray[Any]] = {}
        self.unreadable: dict[str, str] = {}
        empty: dict[str, str] = {}
        for name, column in columns:
            if name in self.names or name in empty:
                raise InvalidInputError(f"{path}: two columns have the name {name!r}; rename one")
            if isinstance(column, Unreadable):
                self.unreadable[name] = column.found
            elif column.dtype.kind not in "buifUMmO":
                self.unreadable[name] = str(column.dtype)
            elif not column.ndim:
                self.unreadable[name] = SCALAR
            elif not column.size:
                empty[name] = f"shape {column.shape}"
            else:
                self._arrays[name] = column
        if empty and not self._arrays:
            raise InvalidInputError(f"{path}: the file has no rows")
        self.unreadable |= empty
        if not self.names:
            raise InvalidInputError(f"{path}: the file has no columns")

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column; raises NotFoundError, or InvalidInputError if it cannot be read."""
        if name in self.unreadable:
            raise InvalidInputError(
                f"{self.path}: expected numbers or text in column {name!r}, "
                f"found {self.unreadable[name]}"
            )
        if name not in self._arrays:
            raise NotFoundError(f"{self.path}: expected one of {self.names}, found {name!r}")
        return self._arrays[name]

    def __contains__(self, name: object) -> bool:
        """Tell whether the file has a readable column of that name."""
        return name in self._arrays

    def __iter__(self) -> Iterator[str]:
        """Go through the names of the readable columns in the order of the file."""
        return iter(self._arrays)

    def __len__(self) -> int:
        """Count the readable columns."""
        return len(self._arrays)

    @property
    def names(self) -> list[str]:
        """The names of all columns, those that cannot be read last."""
        return [*self._arrays, *self.unreadable]

    def numbers(self, name: str, dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """Return a column as finite numbers.

        Parameters
        ----------
        name
            Name of the column.
        dtype
            Type of floats to return.

        Returns
        -------
        NDArray
            (n,) or (n, w), like the column.

        Raises
        ------
        NotFoundError
            If there is no such column.
        InvalidInputError
            If a cell is no number, or not finite in that type; it names row and column.
        """
        column = self[name]
        if column.dtype.kind not in "buif":
            row = next((i for i, cell in enumerate(column) if not _is_number(cell)), 0)
            raise InvalidInputError(
                f"{self.path}: expected numbers in column {name!r}, "
                f"found {str(column[row])!r} at row {row}"
            )
        with np.errstate(over="ignore", invalid="ignore"):
            numbers = column.astype(dtype)
        bad = np.argwhere(~np.isfinite(numbers))
        if len(bad):
            row, *inner = map(int, bad[0])
            place = f"column {name!r}" + (f"[{inner[0]}]" if inner else "")
            raise InvalidInputError(
                f"{self.path}: expected finite {np.dtype(dtype)} numbers, "
                f"found {column[tuple(bad[0])]} at row {row}, {place}"
            )
        return numbers

    def one_per_row(self, name: str) -> NDArray[Any]:
        """Return a column that has one value per row.

        Parameters
        ----------
        name
            Name of the column.

        Returns
        -------
        NDArray
            (n,), of any type.

        Raises
        ------
        NotFoundError
            If there is no such column.
        InvalidInputError
            If a row has several values, or a value is NaN.
        """
        column = self[name]
        if column.size != len(column):
            raise InvalidInputError(
                f"{self.path}: expected one value per row in column {name!r}, "
                f"found shape {column.shape}"
            )
        column = column.reshape(-1)
        missing = np.flatnonzero(column != column)
        if len(missing):
            raise InvalidInputError(
                f"{self.path}: expected a value in column {name!r}, "
                f"found {column[missing[0]]} at row {missing[0]}"
            )
        return column

    def number_per_row(self, name: str, dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """Return a column that has one finite number per row, (n,).

        Parameters
        ----------
        name
            Name of the column.
        dtype
            Type of floats to return.

        Raises
        ------
        NotFoundError, InvalidInputError
            As `numbers` and `one_per_row` do.
        """
        numbers = self.numbers(name, dtype)
        self.one_per_row(name)
        return numbers.reshape(-1)

    def matrix(self, names: Sequence[str]) -> tuple[NDArray[np.float32], list[str]]:
        """Join columns side by side.

        Parameters
        ----------
        names
            Names of columns, each (n,) or (n, v).

        Returns
        -------
        matrix
            (n, w) float32, w the sum of their widths.
        dimensions
            Names of the w dimensions: `speed`, or `lidar[0]`, `lidar[1]`, … of a wide column.

        Raises
        ------
        NotFoundError, InvalidInputError
            As `numbers` does, and for columns of different lengths.
        """
        parts = []
        dimensions = []
        for name in names:
            part = self.numbers(name)
            if part.ndim > 2:
                raise InvalidInputError(
                    f"{self.path}: expected one or two dimensions in {name!r}, found {part.shape}"
                )
            dimensions += (
                [name] if part.ndim == 1 else [f"{name}[{i}]" for i in range(part.shape[1])]
            )
            parts.append(part.reshape(len(part), -1))
        self.check_lengths(names)
        return np.concatenate(parts, axis=1), dimensions

    def check_lengths(self, names: Sequence[str]) -> None:
        """Check that some columns have equally many rows.

        Parameters
        ----------
        names
            Names of columns; the first has the number of rows that is expected.

        Raises
        ------
        InvalidInputError
            If one has another number of rows.
        """
        for name in names:
            count = len(self[names[0]])
            found = len(self[name])
            if found != count:
                raise InvalidInputError(
                    f"{self.path}: expected {count} rows in {name!r} as in {names[0]!r}, "
                    f"found {found}"
                )


def _is_number(cell: Any) -> bool:
    try:
        float(cell)
    except (TypeError, ValueError):
        return False
    return True
