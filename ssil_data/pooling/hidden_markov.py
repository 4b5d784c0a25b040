"""Hidden Markov model: each stretch of an episode is either the expert's or another's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.json_kinds import check_fields, shorten, show_short
from ssil_data.pooling.base import FittedPooling, Pooling, cut_chunks, find_starts
from ssil_data.pooling.forward_backward import infer

ROUNDS = 30
"""Rounds of expectation–maximization at most."""
MOST_BINS = 1024
"""What is learned for a bin is in the run's record."""
LEAST_STAY = 0.5
MOST_STAY = 0.9999


@dataclass(frozen=True)
class HiddenMarkov(Pooling):
    """Sticky model of two states, expert and other, learned from the unlabeled pairs.

    From one pair to the next a drive stays as it is, or is drawn anew. How uncertain pairs of
    either state are is a histogram. Follows quality that changes inside an episode, however long
    the stretches are; a window is better where it does not change.

    Parameters
    ----------
    bins
        Bins of the two histograms, of equal mass over the unlabeled pairs.
    start_share
        Share of the pairs, the least uncertain ones, that begin as the expert's.

    Raises
    ------
    InvalidInputError
        For fewer than 2 bins or more than `MOST_BINS`, or a share outside 0 to 1.

    Source
    ------
    Baum et al., 1970; Rabiner, A Tutorial on Hidden Markov Models, 1989.

    Examples
    --------
    >>> random = np.random.default_rng(0)
    >>> good = np.repeat([1, 0, 1, 0], 100)
    >>> noise = random.normal(size=400) - 2 * good
    >>> pooled = sd.HiddenMarkov(bins=8).fit(noise, np.zeros(400, int))(noise, np.zeros(400, int))
    >>> bool((pooled[good == 1] < 0).mean() > 0.95 and (pooled[good == 0] > 0).mean() > 0.95)
    True
    """

    kind: ClassVar[str] = "hmm"
    bins: int = 32
    start_share: float = 0.1

    def __post_init__(self) -> None:
        """Validate the settings."""
        check_fields(self.kind, self)
        if not 2 <= self.bins <= MOST_BINS:
            raise InvalidInputError(
                f"hmm: bins: expected a whole number from 2 to {MOST_BINS:,}, "
                f"found {show_short(self.bins)}"
            )
        if not 0 < self.start_share < 1:
            raise InvalidInputError(
                f"hmm: start_share: expected a share between 0 and 1, found {self.start_share!r}"
            )

    def fit(self, uncertainty: ArrayLike, episode: NDArray[np.int64]) -> FittedHiddenMarkov:
        """Learn histograms, stay probability and share by expectation–maximization.

        Parameters
        ----------
        uncertainty
            Of the unlabeled pairs, (n,).
        episode
            Number of each pair's episode, (n,).
        """
        values = np.asarray(uncertainty, dtype=np.float32)
        starts = find_starts(episode)
        chunks = list(cut_chunks(episode))
        inside = max(1, np.count_nonzero(~starts))
        edges = np.quantile(values, np.linspace(0, 1, self.bins + 1)[1:-1]).astype(np.float32)
        bin_of = np.searchsorted(edges, values)
        least = np.quantile(values, self.start_share)
        expert = np.where(values <= least, 0.98, 0.02)
        stay = 0.98
        share = self.start_share
        log_ratio = np.zeros(self.bins)
        for _ in range(ROUNDS):
            log_ratio = _estimate_log_ratio(bin_of, expert, self.bins)
            before = expert
            expert = np.empty(len(values))
            redrawn = 0.0
            for rows in chunks:
                evidence = log_ratio[bin_of[rows]]
                expert[rows], drawn = infer(evidence, starts[rows], stay=stay, share=share)
                redrawn += drawn * np.count_nonzero(~starts[rows])
            stay = float(np.clip(1 - redrawn / inside, LEAST_STAY, MOST_STAY))
            share = float(np.clip(expert.mean(), 1e-4, 1 - 1e-4))
            if np.abs(expert - before).mean() < 1e-4:
                break
        return FittedHiddenMarkov(tuple(edges.tolist()), tuple(log_ratio.tolist()), stay, share)


@dataclass(frozen=True)
class FittedHiddenMarkov(FittedPooling):
    """Pooled r = −log-odds of the expert's state, given the whole episode.

    Parameters
    ----------
    edges
        Between the bins of uncertainty.
    log_ratio
        log p(bin | expert) − log p(bin | other), one more than edges.
    stay
        Probability that a step draws no new state.
    share
        Probability that a new state is the expert's.

    Raises
    ------
    InvalidInputError
        For numbers that do not fit each other.
    """

    kind: ClassVar[str] = "hmm"
    edges: Sequence[float]
    log_ratio: Sequence[float]
    stay: float
    share: float

    def __post_init__(self) -> None:
        """Validate the numbers and keep the sequences as tuples."""
        check_fields(self.kind, self)
        with np.errstate(over="ignore"):
            edges = np.asarray(self.edges, dtype=np.float32)
        ratio = np.asarray(self.log_ratio, dtype=np.float64)
        sound = (
            ratio.shape == (len(edges) + 1,)
            and np.isfinite(edges).all()
            and np.isfinite(ratio).all()
            and (np.diff(edges) >= 0).all()
        )
        if not sound or not (0 < self.stay < 1 and 0 < self.share < 1):
            raise InvalidInputError("hmm: its numbers do not fit each other")
        object.__setattr__(self, "edges", shorten(edges))
        object.__setattr__(self, "log_ratio", tuple(ratio.tolist()))

    @property
    def stretch(self) -> int:
        """The mean length of a stretch in one state, at most 101."""
        return int(min(101, 1 / (1 - self.stay)))

    def _pool(
        self, uncertainty: NDArray[np.float32], starts: NDArray[np.bool_]
    ) -> NDArray[np.floating]:
        bin_of = np.searchsorted(np.asarray(self.edges, np.float32), uncertainty)
        evidence = np.asarray(self.log_ratio)[bin_of]
        expert, _ = infer(evidence, starts, stay=self.stay, share=self.share)
        least = np.finfo(np.float32).eps
        chance = np.clip(expert, least, 1 - least)
        return np.log1p(-chance) - np.log(chance)


def _estimate_log_ratio(
    bin_of: NDArray[np.int64], expert: NDArray[np.float64], bins: int
) -> NDArray[np.float64]:
    """Estimate how much likelier each bin is for the expert; one prior pair a bin for either.

    Never rises with uncertainty: a stranger pair speaks for the expert by chance alone, and a rare
    expert is lost where a few do.
    """
    from scipy.optimize import isotonic_regression  # slow to import

    ours = np.bincount(bin_of, expert, bins) + 1
    others = np.bincount(bin_of, 1 - expert, bins) + 1
    ratio = np.log(ours / ours.sum()) - np.log(others / others.sum())
    return isotonic_regression(ratio, weights=ours + others, increasing=False).x
