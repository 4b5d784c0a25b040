"""The leverage field: how expert-like the neighborhood of a state is, over all demonstrations.

With states s_i of leverage l_i and the kernel k_α of standardized states (`ssil_data.kernels`),

    LCoR(s) = Σ l_i k_α(s, s_i) / Σ k_α(s, s_i)                                 (equation 5)

and CoR(s) (equation 2) compares the same kernel's means over the labeled states and all others.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.features import Standardizer
from ssil_data.field.answers import LCoR
from ssil_data.field.engine import FieldEngine
from ssil_data.field.query import LCoROptions, LCoRQuery, check_contributors
from ssil_data.kernels import Sums, check_alpha, cor


@dataclass(frozen=True, eq=False)
class LeverageField:
    """Demonstration states with their leverage, and a kernel over them: LCoR and CoR of any state.

    Parameters
    ----------
    states:
        (n, d) demonstration states in raw units; may be a read-only mapped file.
    leverage:
        (n,) in [0, 1]; 1 is expert-like.
    labeled:
        (n,) true for the states of labeled episodes, the expert states of CoR.
    standardizer:
        Makes the units of the dimensions comparable.
    alpha:
        The kernel's sharpness, > 0: the larger, the fewer demonstrations a value rests on.
    device:
        Where torch keeps the states for exact values, as "cuda"; on "cpu" code is written for the
        processor. Samples are always computed on the processor.
    threads:
        Threads of a query; all of the processor's without.
    engine:
        The packed demonstrations of a field over the same arrays, as `at` and
        `dataclasses.replace` pass them on; made anew without, or for other arrays.

    Raises
    ------
    InvalidInputError
        For no states, values that are not finite, unequal lengths, leverages outside [0, 1], an
        alpha or threads that are none.

    Examples
    --------
    >>> from ssil_data.features import Standardizer
    >>> states = np.array([[0.0], [1.0]], np.float32)
    >>> field = sd.LeverageField(
    ...     states=states,
    ...     leverage=np.array([1.0, 0.0]),
    ...     labeled=np.array([True, False]),
    ...     standardizer=Standardizer.of(states),
    ...     alpha=1.0,
    ... )
    >>> field
    LeverageField(2 states of 1 dimensions, alpha=1)
    >>> field.lcor([[0.5]]).values.round(3).tolist()
    [0.5]
    """

    states: NDArray[np.float32]
    leverage: NDArray[np.float32]
    labeled: NDArray[np.bool_]
    standardizer: Standardizer
    alpha: float
    device: str = "cpu"
    threads: int | None = None
    engine: FieldEngine | None = None

    def __post_init__(self) -> None:
        """Validate, and take the engine over if it is one of these arrays."""
        object.__setattr__(self, "alpha", check_alpha(self.alpha))
        if self.threads is not None and self.threads < 1:
            raise InvalidInputError(f"threads: expected at least 1, found {self.threads}")
        engine = self.engine if self._fits(self.engine) else self._make_engine()
        assert engine is not None
        object.__setattr__(self, "engine", engine)
        object.__setattr__(self, "states", engine.states)
        object.__setattr__(self, "leverage", engine.leverage)
        object.__setattr__(self, "labeled", engine.labeled)

    def _fits(self, engine: FieldEngine | None) -> bool:
        return (
            engine is not None
            and engine.is_made_of(self.states, self.leverage, self.labeled)
            and engine.standardizer is self.standardizer
            and engine.device == self.device
        )

    def _make_engine(self) -> FieldEngine:
        return FieldEngine(
            self.states,
            self.leverage,
            self.labeled,
            standardizer=self.standardizer,
            device=self.device,
        )

    def __repr__(self) -> str:
        """Show size and kernel."""
        count, width = self.states.shape
        return f"LeverageField({count:,} states of {width} dimensions, alpha={self.alpha:.4g})"

    def __reduce__(self) -> tuple[type[LeverageField], tuple[Any, ...]]:
        """Pickle and copy the values; what is packed is made again from them."""
        values = [getattr(self, field.name) for field in fields(self) if field.name != "engine"]
        return LeverageField, tuple(values)

    def at(self, alpha: float) -> LeverageField:
        """Return the field with another sharpness; packed demonstrations are shared.

        Parameters
        ----------
        alpha:
            The kernel's sharpness, > 0.

        Returns
        -------
        LeverageField
            A field over the same demonstrations.

        Raises
        ------
        InvalidInputError
            For an alpha at which the kernel cannot be computed.

        Examples
        --------
        >>> dataset.field("vae").at(3.0).alpha
        3.0
        """
        return replace(self, alpha=alpha)

    def lcor(self, states: ArrayLike, **options: Unpack[LCoROptions]) -> LCoR:
        """Return LCoR of states: near 1 where nearby demonstrations are expert-like, near 0 not.

        Exact values are the same to the last bit on the same processor, whatever other states are
        in the query and by however many threads; torch's (another `device`, α below 1e-3) may
        round otherwise.

        Parameters
        ----------
        states:
            (m, d) in raw units.
        options:
            The fields of `LCoRQuery` as keyword arguments: `contributors`, `tolerance`,
            `relative`, `seconds`, `seed`. The first query with a tolerance or seconds reads all
            demonstrations once more.

        Returns
        -------
        LCoR
            Values (m,), their effective sample sizes, half-widths and contributors.

        Raises
        ------
        InvalidInputError
            For states of another width or not finite, and for options that conflict.

        Notes
        -----
        Equation 5: LCoR(s) = Σ l_i k_α(s, s_i) / Σ k_α(s, s_i).

        Examples
        --------
        >>> field = dataset.field("vae")
        >>> exact = field.lcor(field.states[:5])
        >>> bool(((exact.values >= 0) & (exact.values <= 1)).all())
        True
        >>> field.lcor(field.states[:5], contributors=3).contributors.row.shape
        (5, 3)
        """
        query = LCoRQuery(**options)
        if query.exact:
            return LCoR.of_sums(self.sums(states, contributors=query.contributors))
        return self._estimate(self._engine.standardize(states), query)

    def _estimate(self, queries: NDArray[np.float32], query: LCoRQuery) -> LCoR:
        """Return LCoR of standardized states from a random part of the demonstrations."""
        sampled = self._engine.sampler()
        how: dict[str, Any] = {"alpha": self.alpha, "seed": query.seed, "threads": self.threads}
        if query.seconds is not None:
            return LCoR.of_estimate(sampled.estimate_in_time(queries, seconds=query.seconds, **how))
        assert query.tolerance is not None
        width = query.tolerance * (self._deviation if query.relative else 1.0)
        return LCoR.of_estimate(sampled.estimate_within(queries, tolerance=width, **how))

    def sums(self, states: ArrayLike, *, contributors: int = 0) -> Sums:
        """Return the sums that make LCoR, which add up over the shards of a store.

        Sums over shards with one standardizer and one alpha add up to those over the whole store,
        if `nearest` is numbered over all of it.

        Parameters
        ----------
        states:
            (m, d) in raw units.
        contributors:
            Also return this many demonstration states that weigh most.

        Returns
        -------
        Sums
            Σ l w, Σ w and Σ w² of each state, with w = k / exp(log_scale).

        Raises
        ------
        InvalidInputError
            For states of another width or not finite, and for a negative number.

        Examples
        --------
        >>> field = dataset.field("vae")
        >>> sums = field.sums(field.states[:5])
        >>> bool((sums.numerator / sums.denominator == field.lcor(field.states[:5]).values).all())
        True
        """
        check_contributors(contributors)
        return self._engine.references().sums(
            self._engine.standardize(states),
            alpha=self.alpha,
            contributors=contributors,
            threads=self.threads,
        )

    def cor(self, states: ArrayLike) -> NDArray[np.float64]:
        """Return CoR of states: above 1/2 where the labeled states are nearer than all others.

        Expert states are the labeled ones, negative states all others, as MixGAIL takes them.

        Parameters
        ----------
        states:
            (m, d) in raw units.

        Returns
        -------
        NDArray
            (m,) in [0, 1].

        Raises
        ------
        InvalidInputError
            For states of another width or not finite, and where all states are labeled, or none.

        Notes
        -----
        Equation 2.

        Examples
        --------
        >>> field = dataset.field("vae")
        >>> field.cor(field.states[:5]).shape
        (5,)
        """
        expert, negative = self._engine.moments()
        return cor(self._engine.standardize(states), expert, negative, self.alpha)

    @cached_property
    def _deviation(self) -> float:
        return self._engine.deviation(self.alpha)

    @property
    def _engine(self) -> FieldEngine:
        assert self.engine is not None
        return self.engine
