"""Named columns of any file, checked once, and which of them are what."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ssil_data.errors import InvalidInputError, NotFoundError

_USUAL: Mapping[str, tuple[str, ...]] = {
    "state": ("states", "state"),
    "action": ("actions", "action"),
    "episode": ("episode",),
    # a `step` that nobody named may count anything; only a named one is a promise to check
    "step": (),
    "reward": ("reward", "rewards"),
    "position": ("position", "positions"),
    "score": ("score",),
    "tier": ("tier",),
    "labeled": ("labeled",),
}
_GUESSED_SHAPES: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "reward": ((), (1,)),
    "position": ((2,),),
    "score": ((), (1,)),
    "tier": ((), (1,)),
}
_SCALAR = "a scalar"


@dataclass(frozen=True)
class Layout:
    """Which columns are what. What is not named is taken from columns of the usual names.

    A step is checked only if it is named; a reward, position, score or tier is taken without
    being named only if it has the form of one.

    `state` and `action` join several columns in the given order. `labeled` is the name of a
    column of true and false, or values of the episode column: `3`, `0-9`, `all`.
    """

    state: tuple[str, ...] = ()
    action: tuple[str, ...] = ()
    episode: str | None = None
    step: str | None = None
    reward: str | None = None
    position: tuple[str, ...] = ()
    score: str | None = None
    tier: str | None = None
    labeled: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unreadable:
    """A column whose kind is neither numbers nor text: `found` says what it is."""

    found: str


class Columns(Mapping[str, NDArray[Any]]):
    """The columns of one file by name: (n,) or (n, w) arrays of numbers, text or times.

    A column that cannot be read is not among them, but asking for it says why.
    """

    def __init__(
        self, path: Path, columns: Iterable[tuple[str, NDArray[Any] | Unreadable]]
    ) -> None:
        """Hold what was read from `path`; raises InvalidInputError without names or rows."""
        self.path = path
        self._arrays: dict[str, NDArray[Any]] = {}
        self._unreadable: dict[str, str] = {}
        empty: dict[str, str] = {}
        for name, column in columns:
            if name in self.names or name in empty:
                raise InvalidInputError(
                    f"{path}: expected one column of each name, found {name!r} twice"
                )
            if isinstance(column, Unreadable):
                self._unreadable[name] = column.found
            elif column.dtype.kind not in "buifUMmO":
                self._unreadable[name] = str(column.dtype)
            elif not column.ndim:
                self._unreadable[name] = _SCALAR
            elif not column.size:
                empty[name] = f"shape {column.shape}"
            else:
                self._arrays[name] = column
        if empty and not self._arrays:
            raise InvalidInputError(f"{path}: expected at least one row, found none")
        self._unreadable |= empty
        if not self.names:
            raise InvalidInputError(f"{path}: expected at least one column, found none")

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column; raises NotFoundError, or InvalidInputError if it cannot be read."""
        if name in self._unreadable:
            raise InvalidInputError(
                f"{self.path}: expected numbers or text in column {name!r}, "
                f"found {self._unreadable[name]}"
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
        """All names, those of unreadable columns last."""
        return [*self._arrays, *self._unreadable]

    def numbers(self, name: str, dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """Return a column as finite floats; raises InvalidInputError naming row and column."""
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
        """Return a column of one value per row, (n,); raises InvalidInputError, also for NaN."""
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
        """Return a column of one finite number per row, (n,); raises InvalidInputError."""
        numbers = self.numbers(name, dtype)
        self.one_per_row(name)
        return numbers.reshape(-1)

    def matrix(self, names: Sequence[str]) -> tuple[NDArray[np.float32], list[str]]:
        """Join columns side by side, (n, w), and name the w dimensions."""
        parts, dimensions = [], []
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
        """Raise InvalidInputError unless all these columns have the rows of the first."""
        for name in names:
            count, found = len(self[names[0]]), len(self[name])
            if found != count:
                raise InvalidInputError(
                    f"{self.path}: expected {count} rows in {name!r} as in {names[0]!r}, "
                    f"found {found}"
                )

    def complete(self, layout: Layout) -> Layout:
        """Fill what a layout does not name from the columns of the usual names.

        A column that is named for one role is not taken for another.
        """
        named = [getattr(layout, field.name) for field in fields(layout)]
        taken = {
            name for given in named for name in ([given] if type(given) is str else given or ())
        }
        filled: dict[str, Any] = {}
        for field in fields(layout):
            given = getattr(layout, field.name)
            usual = [
                name
                for name in _USUAL[field.name]
                if name not in taken and self._may_be(field.name, name)
            ][:1]
            if given or not usual:
                filled[field.name] = given
            else:
                filled[field.name] = usual[0] if field.default is None else tuple(usual)
        return Layout(**filled)

    def _may_be(self, role: str, name: str) -> bool:
        if name in self._unreadable:
            return self._unreadable[name] != _SCALAR or role in ("state", "action", "labeled")
        shapes = _GUESSED_SHAPES.get(role)
        return name in self and (shapes is None or self[name].shape[1:] in shapes)


def _is_number(cell: Any) -> bool:
    try:
        float(cell)
    except (TypeError, ValueError):
        return False
    return True
