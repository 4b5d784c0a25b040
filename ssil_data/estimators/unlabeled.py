"""What a fit may know of the unlabeled pairs: how widely they spread, and a sample of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data.demonstrations import Pairs
from ssil_data.features import Standardizer

SAMPLE_ROWS = 32_768
"""Unlabeled pairs in a sample at most."""

SAMPLE_BYTES = 64 << 20
"""Bytes of states and actions in a sample at most, so that wide states fit in memory."""

FARTHEST = 10.0
"""Most that outliers may make of a deviation: one broken sensor must not hide a dimension."""

STRETCH = 256
"""Neighboring pairs that are sampled together, since estimators look at neighbors."""


@dataclass(frozen=True, eq=False)
class UnlabeledSample:
    """A sample of the unlabeled pairs that a run is about, taken without loading them all.

    Parameters
    ----------
    pairs
        The sample, in stretches of neighboring pairs; each stretch counts as an episode.
    state_deviation, action_deviation
        Standard deviation of each state dimension (d,) and action dimension (k,) in the sample; a
        few outliers do not carry it beyond `FARTHEST` times what the middle half speaks for.
    scale_floor
        Least scale of a dimension for an estimator that standardizes by the labeled pairs, as a
        share of its deviation here; 0 for none.

    Examples
    --------
    >>> unlabeled = sd.UnlabeledSample.of(dataset.pairs()[120:], scale_floor=0.3)
    >>> bool((unlabeled.least_state_scale > 0).all())
    True
    """

    pairs: Pairs
    state_deviation: NDArray[np.float64]
    action_deviation: NDArray[np.float64]
    scale_floor: float = 0.0

    @classmethod
    def of(cls, pairs: Pairs, *, scale_floor: float = 0.0) -> UnlabeledSample:
        """Return a sample with its deviations.

        Parameters
        ----------
        pairs
            At least one unlabeled pair.
        scale_floor
            See the class.
        """
        return cls(
            pairs=pairs,
            state_deviation=_find_deviation(pairs.states),
            action_deviation=_find_deviation(pairs.actions),
            scale_floor=scale_floor,
        )

    @property
    def least_state_scale(self) -> NDArray[np.float64]:
        """The least scale of each state dimension, (d,)."""
        return self.scale_floor * self.state_deviation

    @property
    def least_action_scale(self) -> NDArray[np.float64]:
        """The least scale of each action dimension, (k,)."""
        return self.scale_floor * self.action_deviation


def standardize_pairs(
    labeled: Pairs, unlabeled: UnlabeledSample | None
) -> tuple[Standardizer, Standardizer]:
    """Return the standardizers of states and of actions that an estimator works with.

    Parameters
    ----------
    labeled
        The pairs whose mean and deviation they are.
    unlabeled
        A sample of the unlabeled pairs, for the least scale of a dimension; None for none.
    """
    if unlabeled is None:
        return Standardizer.of(labeled.states), Standardizer.of(labeled.actions)
    return (
        Standardizer.of(labeled.states, least=unlabeled.least_state_scale),
        Standardizer.of(labeled.actions, least=unlabeled.least_action_scale),
    )


def sample_unlabeled(
    batches: Iterable[Pairs], labeled: NDArray[np.bool_], *, scale_floor: float
) -> UnlabeledSample | None:
    """Sample the unlabeled pairs of a stream, in stretches that lie evenly over it.

    The sample depends on the pairs alone, not on a seed or on how the stream is cut.

    Parameters
    ----------
    batches
        All pairs in order.
    labeled
        Which of them are labeled, (n,).
    scale_floor
        See `UnlabeledSample`.

    Returns
    -------
    UnlabeledSample or None
        At most `SAMPLE_ROWS` pairs or `SAMPLE_BYTES`; None without an unlabeled pair.
    """
    ordinal = np.cumsum(~labeled) - 1
    count = int(ordinal[-1]) + 1 if len(ordinal) else 0
    if not count:
        return None
    parts: list[tuple[NDArray, ...]] = []
    done = 0
    every = 0
    for batch in batches:
        every = every or _find_interval(count, batch)
        rows = slice(done, done + len(batch))
        done = rows.stop
        chosen = ~labeled[rows] & (ordinal[rows] // STRETCH % every == 0)
        stretch = ordinal[rows][chosen] // STRETCH
        parts.append((batch.states[chosen], batch.actions[chosen], batch.episode[chosen], stretch))
    states, actions, episode, stretch = (np.concatenate(each) for each in zip(*parts, strict=True))
    starts = np.ones(len(states), dtype=bool)
    starts[1:] = (episode[1:] != episode[:-1]) | (stretch[1:] - stretch[:-1] > 1)
    first = np.maximum.accumulate(np.where(starts, np.arange(len(states)), 0))
    pairs = Pairs(
        states, actions, episode=np.cumsum(starts) - 1, step=np.arange(len(states)) - first
    )
    return UnlabeledSample.of(pairs, scale_floor=scale_floor)


def clip_outliers(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return values without what a broken sensor writes: its mean and deviation are worth nothing.

    Parameters
    ----------
    values
        (n, d), at least one row.

    Returns
    -------
    ndarray
        The values, clipped at 100 interquartile ranges beyond the quartiles where there are any.
    """
    low, high = np.quantile(values.astype(np.float64), [0.25, 0.75], axis=0)
    reach = np.where(high > low, 100 * (high - low), np.inf)
    return np.clip(values, low - reach, high + reach).astype(np.float32)


def _find_deviation(values: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the deviation of each column, bounded by its interquartile range where it has one."""
    exact = values.astype(np.float64)
    low, high = np.quantile(exact, [0.25, 0.75], axis=0)
    normal = (high - low) / 1.349
    bound = np.where(normal > 0, FARTHEST * normal, np.inf)
    return np.minimum(exact.std(axis=0), bound)


def _find_interval(count: int, batch: Pairs) -> int:
    """Find of how many stretches one is sampled."""
    width = 4 * (batch.states.shape[1] + batch.actions.shape[1])
    most = max(STRETCH, min(SAMPLE_ROWS, SAMPLE_BYTES // width))
    return -(-count // most)
