"""The two halves of every pooling: settings that fit, and a fitted value that pools episodes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

CHUNK = 1 << 18
"""About so many pairs are pooled at once, whole episodes each, so that memory stays bounded."""


class Pooling(ABC):
    """Settings of a pooling over time; `fit` gives what pools uncertainty inside episodes."""

    kind: ClassVar[str]

    @abstractmethod
    def fit(self, uncertainty: ArrayLike, episode: NDArray[np.int64]) -> FittedPooling:
        """Fit to the uncertainty of unlabeled pairs.

        Parameters
        ----------
        uncertainty
            Of the unlabeled pairs, (n,), finite, at least one.
        episode
            Number of each pair's episode, (n,), rows of one episode adjacent.

        Returns
        -------
        FittedPooling
            What pools any pairs.
        """


@dataclass(frozen=True)
class FittedPooling(ABC):
    """A fitted pooling: stored with a run and used unchanged for pairs that arrive later.

    A pair is pooled with those of its own episode in the same batch: a pair that comes alone is
    judged alone.
    """

    kind: ClassVar[str]

    @property
    def stretch(self) -> int:
        """About how many neighboring pairs one pooled value rests on."""
        return 1

    def __call__(self, uncertainty: ArrayLike, episode: NDArray[np.int64]) -> NDArray[np.float32]:
        """Pool uncertainty over time, never across episodes; larger = stranger.

        Parameters
        ----------
        uncertainty
            (n,), in the order of the pairs.
        episode
            Number of each pair's episode, (n,), rows of one episode adjacent.

        Returns
        -------
        ndarray
            (n,) float32.
        """
        values = np.asarray(uncertainty, dtype=np.float32)
        pooled = np.empty(len(values), np.float32)
        for rows in cut_chunks(episode):
            pooled[rows] = self._pool(values[rows], find_starts(episode[rows]))
        return pooled

    @abstractmethod
    def _pool(
        self, uncertainty: NDArray[np.float32], starts: NDArray[np.bool_]
    ) -> NDArray[np.floating]:
        """Pool whole episodes, whose first rows are marked."""


def find_starts(episode: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mark the first row of each episode.

    Parameters
    ----------
    episode
        Number of each row's episode, (n,).
    """
    starts = np.ones(len(episode), dtype=bool)
    starts[1:] = episode[1:] != episode[:-1]
    return starts


def cut_chunks(episode: NDArray[np.int64]) -> Iterator[slice]:
    """Cut rows into slices of about `CHUNK` rows, at the beginnings of episodes.

    Parameters
    ----------
    episode
        Number of each row's episode, (n,).
    """
    bounds = [*np.flatnonzero(find_starts(episode)).tolist(), len(episode)]
    first = 0
    for bound in bounds:
        if bound - first >= CHUNK or bound == len(episode):
            if bound > first:
                yield slice(first, bound)
            first = bound
