"""The leverage field: how good is the neighbourhood of a state, asked of all demonstrations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.demonstrations import finite_matrix
from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardiser
from ssil_data.kernels import Moments, References, checked_alpha, cor, log_kernel

ALPHA_RANGE = (1e-2, 1e4)
"""Where `auto_alpha` looks; beyond its upper end the kernel no longer changes: exp(−d/2)."""


@dataclass(frozen=True, eq=False)
class Contributors:
    """The demonstration states that contributed most to each of m answers, most first.

    row (m, c) is their place in the field, share (m, c) the part of the answer's weight.
    """

    row: NDArray[np.int64]
    share: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LCoR:
    """Answers to m queries, each (m,): LCoR in [min l, max l], and how many states it rests on."""

    values: NDArray[np.float64]
    effective_sample_size: NDArray[np.float64]
    contributors: Contributors


@dataclass(frozen=True, eq=False)
class LeverageField:
    """Demonstration states (n, d) in raw units with their leverage (n,), and a kernel over them.

    `standardiser` makes units comparable, `alpha` > 0 is the kernel's sharpness, `labeled` (n,)
    tells the expert states of CoR from the rest. Raises InvalidInputError for unequal lengths.
    """

    states: NDArray[np.float32]
    leverage: NDArray[np.float32]
    labeled: NDArray[np.bool_]
    standardiser: Standardiser
    alpha: float

    def __post_init__(self) -> None:
        """Validate lengths and alpha."""
        object.__setattr__(self, "alpha", checked_alpha(self.alpha))
        object.__setattr__(self, "states", finite_matrix("states", self.states))
        for name in ("leverage", "labeled"):
            if len(getattr(self, name)) != len(self.states):
                raise InvalidInputError(
                    f"{name}: expected one per state, "
                    f"found {len(getattr(self, name))} != {len(self.states)}"
                )
        if not len(self.states):
            raise InvalidInputError("states: expected at least one, found none")

    def lcor(self, states: ArrayLike, *, contributors: int = 0) -> LCoR:
        """Return LCoR (equation 5) of states (m, d) in raw units.

        With `contributors` > 0 also the states that contributed most. Raises InvalidInputError for
        another width, non-finite states or negative `contributors`.
        """
        if contributors < 0:
            raise InvalidInputError(f"contributors: expected at least 0, found {contributors}")
        sums = self._references.sums(
            self._standardised(states), alpha=self.alpha, contributors=contributors
        )
        share = sums.nearest_weight / sums.denominator[:, None]
        return LCoR(sums.values, sums.effective_sample_size, Contributors(sums.nearest, share))

    def cor(self, states: ArrayLike) -> NDArray[np.float64]:
        """Return CoR (equation 2) of states (m, d) in raw units, (m,) in [0, 1].

        Expert states are the labeled ones, negative states all others, as MixGAIL takes them.
        """
        expert, negative = self._moments
        return cor(self._standardised(states), expert, negative, self.alpha)

    @cached_property
    def _references(self) -> References:
        return References(self.standardiser(self.states), self.leverage)

    @cached_property
    def _moments(self) -> tuple[Moments, Moments]:
        count = int(self.labeled.sum())
        if not 0 < count < len(self.labeled):
            raise InvalidInputError(
                f"cor: expected labeled and unlabeled states, found {count} labeled of "
                f"{len(self.labeled)}"
            )
        states = self.standardiser(self.states)
        return Moments.of(states[self.labeled]), Moments.of(states[~self.labeled])

    def _standardised(self, states: ArrayLike) -> NDArray[np.float32]:
        return self.standardiser(finite_matrix("states", states, width=self.states.shape[1]))


def auto_alpha(standardised: NDArray[np.float32], *, share: float = 0.1, seed: int = 0) -> float:
    """Return the α at which an answer rests on `share` of the store on average.

    Bisects on a sample of the standardised states (n, d): 64 of them ask, up to 2,048 others
    answer. Where no α in ALPHA_RANGE is sharp or flat enough, the nearer end is returned.
    """
    order = np.random.default_rng(seed).permutation(len(standardised))
    queries, references = standardised[order[:64]], standardised[order[64 : 64 + 2048]]
    if not len(references):
        references = queries
    distance = np.stack([np.abs(references - query).sum(axis=1) for query in queries])
    low, high = np.log(ALPHA_RANGE)
    for _ in range(16):
        middle = (low + high) / 2
        flat = _effective_share(distance, np.exp(middle)) > share
        low, high = (middle, high) if flat else (low, middle)
    return float(np.exp((low + high) / 2))


def _effective_share(distance: NDArray[np.float32], alpha: float) -> float:
    log_weights = log_kernel(distance, alpha)
    weights = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
    sizes = weights.sum(axis=1) ** 2 / (weights**2).sum(axis=1)
    return float(sizes.mean() / distance.shape[1])
