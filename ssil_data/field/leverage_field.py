"""The leverage field: how good is the neighbourhood of a state, asked of all demonstrations."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from threading import RLock
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.demonstrations import finite_matrix, finite_vector
from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardizer
from ssil_data.field.answers import Accuracy, LCoR
from ssil_data.kernels import (
    Moments,
    References,
    Sampled,
    Sums,
    check_alpha,
    cor,
    log_kernel,
)

ALPHA_RANGE = (1e-2, 1e4)
"""Where `auto_alpha` looks; beyond its upper end the kernel no longer changes: exp(−d/2)."""
_DEVIATION_QUERIES = 256
"""States that are asked for the deviation of LCoR."""
_SHIFT = 0.1
"""Part of its share of the store by which `auto_alpha` lets an answer miss, for an odd α."""


@dataclass(frozen=True, eq=False)
class LeverageField:
    """Demonstration states (n, d) in raw units with their leverage (n,), and a kernel over them.

    `standardiser` makes units comparable, `alpha` > 0 is the kernel's sharpness, `labeled` (n,)
    tells the expert states of CoR from the rest. States may be a read-only mapped file. `device` is
    where torch holds them for exact answers, as "cuda"; on "cpu" code is written for the
    processor, and samples are always asked there, by `threads` or all its processors. Raises
    InvalidInputError for unequal lengths and for leverages outside [0, 1].
    """

    states: NDArray[np.float32]
    leverage: NDArray[np.float32]
    labeled: NDArray[np.bool_]
    standardiser: Standardizer
    alpha: float
    device: str = "cpu"
    threads: int | None = None
    _lock: RLock = field(default_factory=RLock, init=False, repr=False)

    def __post_init__(self) -> None:
        """Validate lengths and alpha."""
        object.__setattr__(self, "alpha", check_alpha(self.alpha))
        object.__setattr__(self, "states", finite_matrix("states", self.states))
        object.__setattr__(self, "leverage", finite_vector("leverage", self.leverage))
        object.__setattr__(self, "labeled", np.asarray(self.labeled, bool))
        for name in ("leverage", "labeled"):
            if getattr(self, name).shape != self.states.shape[:1]:
                raise InvalidInputError(
                    f"{name}: expected one per state, "
                    f"found shape {getattr(self, name).shape} for {len(self.states)} states"
                )
        outside = np.flatnonzero((self.leverage < 0) | (self.leverage > 1))
        if len(outside):
            row = int(outside[0])
            raise InvalidInputError(
                f"leverage: expected numbers from 0 to 1, found {self.leverage[row]} at row {row}"
            )
        if not len(self.states):
            raise InvalidInputError("states: expected at least one, found none")
        if self.threads is not None and self.threads < 1:
            raise InvalidInputError(f"threads: expected at least 1, found {self.threads}")

    def __repr__(self) -> str:
        """Show size and kernel."""
        count, width = self.states.shape
        return f"LeverageField({count:,} states of {width} dimensions, alpha={self.alpha:.4g})"

    def at(self, alpha: float) -> LeverageField:
        """Return the field with another sharpness; what is packed by now is shared."""
        other = object.__new__(LeverageField)
        other.__dict__.update(self.__dict__, alpha=check_alpha(alpha))
        other.__dict__.pop("_deviation", None)
        return other

    def __reduce__(self) -> tuple[type[LeverageField], tuple[Any, ...]]:
        """Copy what it was made of, not what it has packed."""
        return LeverageField, tuple(getattr(self, f.name) for f in fields(self) if f.init)

    def lcor(
        self,
        states: ArrayLike,
        *,
        contributors: int = 0,
        tolerance: float | None = None,
        relative: bool = False,
        seconds: float | None = None,
        seed: int = 0,
    ) -> LCoR:
        """Return LCoR (equation 5) of states (m, d) in raw units.

        All demonstration states are asked, and with `contributors` > 0 those that contributed most
        are named. `tolerance`, `relative`, `seconds` and `seed` are those of `Accuracy`; the first
        such answer reads all states once more. But for `seconds`, an answer is the same to the last
        bit on the same processor, whatever is asked with it and by however many threads; torch's
        (another `device`, α below 1e-3) may round otherwise. Raises InvalidInputError for another
        width, non-finite states, or options that contradict each other.
        """
        accuracy = Accuracy(tolerance, relative, seconds, seed)
        if accuracy.exact:
            return LCoR.of_sums(self.sums(states, contributors=contributors))
        if contributors:
            raise InvalidInputError(
                "contributors: expected 0 with a tolerance or seconds, as only all states "
                f"together can name them, found {contributors}"
            )
        queries, sampled = self._standardize(states), self._sampled_references()
        how: dict[str, Any] = {"alpha": self.alpha, "seed": seed, "threads": self.threads}
        if accuracy.seconds is not None:
            found = sampled.in_time(queries, seconds=accuracy.seconds, **how)
        else:
            assert accuracy.tolerance is not None
            width = accuracy.tolerance * (self._deviation if relative else 1.0)
            found = sampled.within(queries, tolerance=width, **how)
        return LCoR.of_estimate(found)

    def sums(self, states: ArrayLike, *, contributors: int = 0) -> Sums:
        """Return the sums that make LCoR of states (m, d) in raw units.

        Those over shards with one standardiser and alpha add up, where `nearest` is numbered over
        all of them. Errors as in `lcor`.
        """
        if contributors < 0:
            raise InvalidInputError(f"contributors: expected at least 0, found {contributors}")
        queries = self._standardize(states)
        return self._references().sums(
            queries, alpha=self.alpha, contributors=contributors, threads=self.threads
        )

    def cor(self, states: ArrayLike) -> NDArray[np.float64]:
        """Return CoR (equation 2) of states (m, d) in raw units, (m,) in [0, 1].

        Expert states are the labeled ones, negative states all others, as MixGAIL takes them.
        """
        expert, negative = self._moments
        return cor(self._standardize(states), expert, negative, self.alpha)

    @cached_property
    def _rows(self) -> _StandardizedRows:
        return _StandardizedRows(self.states, self.standardiser)

    @cached_property
    def _references_cache(self) -> References:
        return References(self._rows, self.leverage, device=self.device)

    def _references(self) -> References:
        with self._lock:
            return self._references_cache

    @cached_property
    def _sampled_cache(self) -> Sampled:
        return Sampled(self._rows, self.leverage, self._references)

    def _sampled_references(self) -> Sampled:
        with self._lock:
            return self._sampled_cache

    @cached_property
    def _deviation(self) -> float:
        """Return the standard deviation of LCoR over the demonstration states, from a sample."""
        chosen = np.random.default_rng(0).integers(len(self.states), size=_DEVIATION_QUERIES)
        found = self._sampled_references().deviation(self._rows[chosen], alpha=self.alpha)
        return max(found, np.finfo(float).tiny)

    @cached_property
    def _moments(self) -> tuple[Moments, Moments]:
        count = int(self.labeled.sum())
        if not 0 < count < len(self.labeled):
            raise InvalidInputError(
                f"cor: expected labeled and unlabeled states, found {count} labeled of "
                f"{len(self.labeled)}"
            )
        expert, negative = (
            Moments.of_parts(self._rows[part] for part in _parts(np.flatnonzero(chosen)))
            for chosen in (self.labeled, ~self.labeled)
        )
        return expert, negative

    def _standardize(self, states: ArrayLike) -> NDArray[np.float32]:
        return self.standardiser(finite_matrix("states", states, width=self.states.shape[1]))


@dataclass(frozen=True)
class _StandardizedRows:
    """States as the kernel sees them, converted as they are read."""

    states: NDArray[np.float32]
    standardiser: Standardizer

    @property
    def shape(self) -> tuple[int, ...]:
        return self.states.shape

    def __getitem__(self, rows: slice | NDArray[np.int64], /) -> NDArray[np.float32]:
        return self.standardiser(self.states[rows])


def _parts(rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    return np.array_split(rows, -(-len(rows) // (1 << 18)))


def auto_alpha(standardised: NDArray[np.float32], *, share: float = 0.1, seed: int = 0) -> float:
    """Return the α at which an answer rests on `share` of the store on average.

    Bisects on a sample of the standardised states (n, d): 64 of them ask, up to 2,048 others
    answer. Where no α in ALPHA_RANGE is sharp or flat enough, the nearer end is returned. The
    nearest odd α is taken instead where that moves the sample's share by less than a tenth:
    its power is whole, and up to 199 LCoR is then quicker by up to a third.
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
    found = float(np.exp((low + high) / 2))
    odd = 2.0 * round((found - 1) / 2) + 1
    moved = _effective_share(distance, odd) / _effective_share(distance, found) - 1
    return odd if abs(moved) < _SHIFT else found


def _effective_share(distance: NDArray[np.float32], alpha: float) -> float:
    log_weights = log_kernel(distance, alpha)
    weights = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
    sizes = weights.sum(axis=1) ** 2 / (weights**2).sum(axis=1)
    return float(sizes.mean() / distance.shape[1])
