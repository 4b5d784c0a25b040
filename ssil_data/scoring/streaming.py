"""One pass over pairs in bounded memory: their uncertainty, and what a field needs to know."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs, join_pairs
from ssil_data.errors import DamagedError
from ssil_data.estimators import Fitted
from ssil_data.scoring.served import Progress
from ssil_data.store.dataset import Dataset

SAMPLE = 4096
"""About so many states, evenly spaced, are kept from the stream to choose the kernel by."""


@dataclass(frozen=True, eq=False)
class Streamed:
    """What one pass over n pairs gives.

    Parameters
    ----------
    uncertainty
        Of every pair, (n,).
    parts
        What it is made of, by name, (n,) each.
    mean, variance
        Of each state dimension, (d,).
    sample
        Some `SAMPLE` states, evenly spaced, (m, d).
    """

    uncertainty: NDArray[np.float32]
    parts: Mapping[str, NDArray[np.float32]]
    mean: NDArray[np.float64]
    variance: NDArray[np.float64]
    sample: NDArray[np.float32]


def stream(
    batches: Iterable[Pairs], fitted: Fitted, *, count: int, progress: Callable[[int], None]
) -> Streamed:
    """Give every pair its uncertainty, batch by batch.

    Memory: 4 bytes a pair, and 4 for each part, beside one batch.

    Parameters
    ----------
    batches
        The pairs in order; episodes may be cut between batches.
    fitted
        The estimator.
    count
        How many pairs there are, by the log.
    progress
        Called with how many pairs are done.

    Returns
    -------
    Streamed
        Uncertainty of the pairs, moments and a sample of their states.

    Raises
    ------
    DamagedError
        Where there are fewer or more pairs than `count`.
    """
    uncertainty = np.empty(count, np.float32)
    parts: dict[str, NDArray[np.float32]] = {}
    moments = _Moments()
    sample: list[NDArray[np.float32]] = []
    stride = max(1, count // SAMPLE)
    done = 0
    for batch, inner in add_margins(batches, fitted.margin):
        answer = fitted.uncertainty(batch)
        states = batch.states[inner]
        rows = slice(done, done + len(states))
        if rows.stop > count:
            raise DamagedError(f"pairs: expected {count} as logged, found {rows.stop} or more")
        uncertainty[rows] = answer.total[inner]
        for name, values in answer.parts.items():
            parts.setdefault(name, np.empty(count, np.float32))[rows] = values[inner]
        moments.add(states)
        sample.append(states[-done % stride :: stride])
        done = rows.stop
        progress(done)
    if done != count:
        raise DamagedError(f"pairs: expected {count} as logged, found {done}")
    return Streamed(uncertainty, parts, moments.mean, moments.variance, np.concatenate(sample))


def stream_dataset(dataset: Dataset, fitted: Fitted, report: Progress) -> Streamed:
    """Give every pair of a dataset its uncertainty.

    Parameters
    ----------
    dataset
        The dataset.
    fitted
        The estimator.
    report
        Called with what is done.
    """
    count = len(dataset)
    return stream(
        dataset.batches(), fitted, count=count, progress=lambda done: report("score", done, count)
    )


def add_margins(batches: Iterable[Pairs], margin: int) -> Iterator[tuple[Pairs, slice]]:
    """Give each batch some rows of its neighbors, so that the cuts between batches do not show.

    Parameters
    ----------
    batches
        Pairs in order.
    margin
        Rows of the batch before and of the batch after; 0 gives the batches as they are.

    Returns
    -------
    Iterator
        Each batch with its margins, and where its own rows lie in it.
    """
    before: Pairs | None = None
    current: Pairs | None = None
    for after in batches:
        if current is not None:
            yield _with_margin(before, current, after, margin)
        before = current
        current = after
    if current is not None:
        yield _with_margin(before, current, None, margin)


def _with_margin(
    before: Pairs | None, current: Pairs, after: Pairs | None, margin: int
) -> tuple[Pairs, slice]:
    if margin == 0:
        return current, slice(0, len(current))
    head = [] if before is None else [before[max(0, len(before) - margin) :]]
    tail = [] if after is None else [after[:margin]]
    first = sum(map(len, head))
    return join_pairs([*head, current, *tail]), slice(first, first + len(current))


class _Moments:
    """Mean and variance of a stream of rows, joined batch by batch (Chan et al., 1983)."""

    def __init__(self) -> None:
        self.count = 0
        self.mean: NDArray[np.float64] = np.zeros(0)
        self._squares: NDArray[np.float64] = np.zeros(0)

    @property
    def variance(self) -> NDArray[np.float64]:
        return self._squares / self.count

    def add(self, rows: NDArray[np.float32]) -> None:
        values = rows.astype(np.float64)
        mean = np.ones(len(values)) @ values / len(values)
        values -= mean
        squares = np.einsum("nd,nd->d", values, values)
        if not self.count:
            self.count = len(values)
            self.mean = mean
            self._squares = squares
            return
        total = self.count + len(values)
        offset = mean - self.mean
        self.mean = self.mean + offset * (len(values) / total)
        self._squares = self._squares + squares + offset**2 * (self.count * len(values) / total)
        self.count = total
