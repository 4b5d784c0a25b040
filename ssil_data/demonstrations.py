"""Demonstrations as values: pairs of state and action, and episodes; validated when made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError

_CHUNK_ROWS = 1 << 18
"""Rows that are checked at once: mapped files may be larger than the memory."""
ENDINGS = ("terminated", "truncated", "cut")
"""How an episode ended: by the task, by a time limit, or because its recording was cut."""


def finite_matrix(name: str, values: ArrayLike, *, width: int | None = None) -> NDArray[np.float32]:
    """Return values as a read-only matrix of finite float32 numbers.

    A read-only float32 array, such as a mapped file, is not copied.

    Parameters
    ----------
    name
        What the message calls the values.
    values
        Numbers, (n, width).
    width
        The expected width, None for any.

    Returns
    -------
    ndarray
        (n, width) float32.

    Raises
    ------
    InvalidInputError
        For NaN, infinity, overflow or another shape; names the row and the column.
    """
    try:
        given = np.asarray(values)
        usable = given.dtype == np.float32 and given.flags.c_contiguous and _is_frozen(given)
        with np.errstate(over="ignore"):
            matrix = given if usable else np.array(given, dtype=np.float32, order="C")
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name}: not numbers: {error}") from None
    if matrix.ndim != 2:
        raise InvalidInputError(f"{name}: expected two dimensions, found shape {matrix.shape}")
    if width is not None and matrix.shape[1] != width:
        raise InvalidInputError(f"{name}: expected width {width}, found {matrix.shape[1]}")
    for first in range(0, len(matrix), _CHUNK_ROWS):
        bad = np.argwhere(~np.isfinite(matrix[first : first + _CHUNK_ROWS]))
        if len(bad):
            row = first + int(bad[0][0])
            column = int(bad[0][1])
            raise InvalidInputError(
                f"{name}: expected finite float32 numbers, found {given[row, column]} "
                f"at row {row}, column {column}"
            )
    matrix.flags.writeable = False
    return matrix


def finite_vector(name: str, values: ArrayLike) -> NDArray[np.float32]:
    """Return values as a read-only vector of finite float32 numbers, as `finite_matrix` does.

    Parameters
    ----------
    name
        What the message calls the values.
    values
        Numbers, (n,).

    Raises
    ------
    InvalidInputError
        For NaN, infinity, overflow or another shape; names the row.
    """
    given = np.asarray(values)
    if given.ndim != 1:
        raise InvalidInputError(f"{name}: expected one dimension, found shape {given.shape}")
    return finite_matrix(name, given[:, None])[:, 0]


def _is_frozen(array: NDArray[np.generic]) -> bool:
    """Tell whether an array, and those it is a view of, are all read-only."""
    base: object = array
    while isinstance(base, np.ndarray):
        if base.flags.writeable:
            return False
        base = base.base
    return True


def _integers(name: str, values: ArrayLike) -> NDArray[np.int64]:
    """Return values as a read-only vector of int64."""
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
    """State–action pairs in the order of their episodes; the arrays become read-only.

    Rows of one episode are adjacent and their steps rise by one: a batch may begin or end in the
    middle of an episode, but never skips inside it.

    Parameters
    ----------
    states
        (n, d) float32, finite.
    actions
        (n, k) float32, finite.
    episode
        Number of each pair's episode, (n,) int64.
    step
        Its place in the episode, (n,) int64.

    Raises
    ------
    InvalidInputError
        For values that are not finite, lengths that differ, or steps that skip.

    Examples
    --------
    >>> states, actions = np.zeros((3, 2)), np.zeros((3, 1))
    >>> pairs = sd.Pairs(states, actions, episode=np.array([7, 7, 8]), step=np.array([0, 1, 0]))
    >>> len(pairs), pairs[:2].episode.tolist()
    (3, [7, 7])
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
            raise InvalidInputError("episode: the rows of an episode are not adjacent")

    def __len__(self) -> int:
        """Count the pairs."""
        return len(self.states)

    def __getitem__(self, rows: slice) -> Pairs:
        """Return some of the pairs.

        Parameters
        ----------
        rows
            A slice without a step, since steps may not skip.
        """
        return Pairs(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})

    def where(self, keep: NDArray[np.bool_]) -> Pairs:
        """Return the pairs that a mask selects.

        Parameters
        ----------
        keep
            (n,); it selects whole episodes or ends of them, since steps may not skip.
        """
        return Pairs(**{field.name: getattr(self, field.name)[keep] for field in fields(self)})


def join_pairs(parts: Sequence[Pairs]) -> Pairs:
    """Return batches of pairs that follow each other as one.

    Parameters
    ----------
    parts
        At least one batch, in order.
    """
    names = [field.name for field in fields(Pairs)]
    return Pairs(**{name: np.concatenate([getattr(p, name) for p in parts]) for name in names})


@dataclass(frozen=True, eq=False)
class Episode:
    """One demonstration of T pairs and what is known of it; the arrays become read-only.

    Parameters
    ----------
    states
        (T, d) float32, finite.
    actions
        (T, k) float32, finite.
    labeled
        Whether it is known to be an expert's.
    source
        Where it comes from, such as a file or a driver.
    rewards
        (T,); for evaluation only.
    positions
        (T, 2) in meters; for maps only.
    score
        True quality, the expert's mean is 1; for evaluation only.
    tier
        A band of that quality, `expert` for the best; for evaluation only.
    ending
        How it ended: `terminated` by the task, `truncated` by a time limit, or `cut` because its
        recording was.

    Raises
    ------
    InvalidInputError
        For values that are not finite, lengths that differ, no pair, or another ending.

    Examples
    --------
    >>> lap = sd.Episode(states=np.zeros((50, 3)), actions=np.zeros((50, 2)), labeled=True)
    >>> len(lap), lap.states.dtype
    (50, dtype('float32'))
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
