"""Demonstrations as values: pairs of state and action, and episodes of them, validated once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError

_CHUNK_ROWS = 1 << 18
"""Rows that are looked at together: mapped files may be larger than the memory."""
ENDINGS = ("terminated", "truncated", "cut")
"""How an episode ended: by the task, by a time limit, or because its recording was cut."""


def finite_matrix(name: str, values: ArrayLike, *, width: int | None = None) -> NDArray[np.float32]:
    """Return `values` as a read-only (n, width) float32 array, refusing NaN, infinity and overflow.

    A read-only float32 array, such as a mapped file, is not copied. Raises InvalidInputError naming
    `name`, the row and the column.
    """
    try:
        given = np.asarray(values)
        taken = given.dtype == np.float32 and given.flags.c_contiguous and _is_frozen(given)
        with np.errstate(over="ignore"):
            matrix = given if taken else np.array(given, dtype=np.float32, order="C")
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name}: expected numbers, found {error}") from None
    if matrix.ndim != 2:
        raise InvalidInputError(f"{name}: expected two dimensions, found shape {matrix.shape}")
    if width is not None and matrix.shape[1] != width:
        raise InvalidInputError(f"{name}: expected width {width}, found {matrix.shape[1]}")
    for first in range(0, len(matrix), _CHUNK_ROWS):
        bad = np.argwhere(~np.isfinite(matrix[first : first + _CHUNK_ROWS]))
        if len(bad):
            row, column = first + int(bad[0][0]), int(bad[0][1])
            raise InvalidInputError(
                f"{name}: expected finite float32 numbers, found {given[row, column]} "
                f"at row {row}, column {column}"
            )
    matrix.flags.writeable = False
    return matrix


def finite_vector(name: str, values: ArrayLike) -> NDArray[np.float32]:
    """Return `values` as a read-only (n,) float32 array; as `finite_matrix`."""
    given = np.asarray(values)
    if given.ndim != 1:
        raise InvalidInputError(f"{name}: expected one dimension, found shape {given.shape}")
    return finite_matrix(name, given[:, None])[:, 0]


def _is_frozen(array: NDArray[np.generic]) -> bool:
    """Tell whether nobody can write to an array, nor to one that it is a view of."""
    base: object = array
    while isinstance(base, np.ndarray):
        if base.flags.writeable:
            return False
        base = base.base
    return True


def _integers(name: str, values: ArrayLike) -> NDArray[np.int64]:
    given = np.asarray(values)
    if given.ndim != 1 or not np.issubdtype(given.dtype, np.integer):
        raise InvalidInputError(
            f"{name}: expected one integer per pair, found {given.dtype} of shape {given.shape}"
        )
    large = np.flatnonzero(given > np.iinfo(np.int64).max)
    if len(large):
        raise InvalidInputError(
            f"{name}: expected integers below 2**63, found {given[large[0]]} at row {large[0]}"
        )
    integers = np.array(given, dtype=np.int64)
    integers.flags.writeable = False
    return integers


@dataclass(frozen=True, eq=False)
class Pairs:
    """State–action pairs in the order of their episodes; arrays are read-only.

    states (n, d) float32, actions (n, k) float32, episode (n,) int64, step (n,) int64.
    Rows of one episode are adjacent and their steps rise by one: a batch may begin or end in the
    middle of an episode, but never skips inside it.
    """

    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    episode: NDArray[np.int64]
    step: NDArray[np.int64]

    def __post_init__(self) -> None:
        """Validate shapes, finiteness and order."""
        object.__setattr__(self, "states", finite_matrix("states", self.states))
        object.__setattr__(self, "actions", finite_matrix("actions", self.actions))
        object.__setattr__(self, "episode", _integers("episode", self.episode))
        object.__setattr__(self, "step", _integers("step", self.step))
        for field in fields(self):
            length = len(getattr(self, field.name))
            if length != len(self.states):
                raise InvalidInputError(
                    f"{field.name}: expected one row per state, "
                    f"found {length} != {len(self.states)}"
                )
        same = self.episode[1:] == self.episode[:-1]
        skips = np.flatnonzero(same & (np.diff(self.step) != 1))
        if len(skips):
            row = int(skips[0]) + 1
            raise InvalidInputError(
                f"step: expected {self.step[row - 1] + 1} at row {row} of episode "
                f"{self.episode[row]}, found {self.step[row]}"
            )
        starts = self.episode[np.flatnonzero(np.r_[True, ~same])] if len(self) else self.episode
        if len(np.unique(starts)) != len(starts):
            raise InvalidInputError("episode: expected adjacent rows, found an episode twice")

    def __len__(self) -> int:
        """Count the pairs."""
        return len(self.states)

    def __getitem__(self, rows: slice) -> Pairs:
        """Return a slice of the pairs; views, validated already."""
        part = object.__new__(Pairs)
        for field in fields(self):
            object.__setattr__(part, field.name, getattr(self, field.name)[rows])
        return part

    def where(self, keep: NDArray[np.bool_]) -> Pairs:
        """Return the pairs for which `keep` (n,) is true; whole episodes or ends of them."""
        return Pairs(**{field.name: getattr(self, field.name)[keep] for field in fields(self)})


def join_pairs(parts: Sequence[Pairs]) -> Pairs:
    """Return pairs that follow each other as one."""
    names = [field.name for field in fields(Pairs)]
    return Pairs(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})


@dataclass(frozen=True, eq=False)
class Episode:
    """One demonstration of T pairs and what is known of it; arrays are read-only.

    states (T, d) and actions (T, k) float32; rewards (T,) and positions (T, 2) in metres are kept
    for evaluation and maps. `score` (true quality, the expert's mean is 1) and `tier` (a band of
    that quality) are for evaluation only: no estimator or trainer reads them.
    """

    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    labeled: bool = False
    source: str = ""
    rewards: NDArray[np.float32] | None = None
    positions: NDArray[np.float32] | None = None
    score: float | None = None
    tier: str | None = None
    ending: str = "cut"

    def __post_init__(self) -> None:
        """Validate shapes, finiteness and the ending."""
        object.__setattr__(self, "states", finite_matrix("states", self.states))
        object.__setattr__(self, "actions", finite_matrix("actions", self.actions))
        if self.rewards is not None:
            object.__setattr__(self, "rewards", finite_vector("rewards", self.rewards))
        if self.positions is not None:
            positions = finite_matrix("positions", self.positions, width=2)
            object.__setattr__(self, "positions", positions)
        if not len(self.states):
            raise InvalidInputError("episode: expected at least one pair, found none")
        for name in ("actions", "rewards", "positions"):
            values = getattr(self, name)
            if values is not None and len(values) != len(self.states):
                raise InvalidInputError(
                    f"{name}: expected one row per state, found {len(values)} != {len(self.states)}"
                )
        if self.score is not None and not np.isfinite(self.score):
            raise InvalidInputError(f"score: expected a finite number, found {self.score}")
        if self.ending not in ENDINGS:
            raise InvalidInputError(f"ending: expected one of {ENDINGS}, found {self.ending!r}")

    def __len__(self) -> int:
        """Count the pairs."""
        return len(self.states)
