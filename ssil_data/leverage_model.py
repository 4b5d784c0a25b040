"""A run's model, which gives any pair a leverage, and what it gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ssil_data import pooling, scales
from ssil_data.demonstrations import Pairs
from ssil_data.estimators import Fitted, load
from ssil_data.pooling import FittedPooling
from ssil_data.pooling.single import FittedSingle
from ssil_data.scales import FittedScale


@dataclass(frozen=True, eq=False)
class Scored:
    """What a model gives n pairs.

    Parameters
    ----------
    uncertainty
        (n,) float32; larger = less like the labeled pairs.
    parts
        What it is made of, by name, (n,) each.
    leverage
        (n,) float32 in [0, 1]; 1 = expert-like.
    pooled
        Uncertainty pooled over time, (n,) float32; without pooling, the uncertainty.
    """

    uncertainty: NDArray[np.float32]
    parts: Mapping[str, NDArray[np.float32]]
    leverage: NDArray[np.float32]
    pooled: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class LeverageModel:
    """A fitted estimator with its fitted scale: gives leverage to pairs, scored before or not.

    Parameters
    ----------
    estimator
        From pairs to uncertainty.
    scale
        From pooled uncertainty to leverage.
    pooling
        Pools uncertainty over time, inside the episodes of the pairs that come together: a pair
        that comes alone is judged alone.

    Examples
    --------
    >>> model = dataset.model("vae")
    >>> scored = model(dataset.episode(0))
    >>> bool(np.array_equal(scored.leverage, dataset.leverage("vae")[: len(scored.leverage)]))
    True
    """

    estimator: Fitted
    scale: FittedScale
    pooling: FittedPooling = field(default_factory=FittedSingle)

    @classmethod
    def from_archive(
        cls,
        archive: bytes,
        fitted_scale: Mapping[str, Any],
        fitted_pooling: Mapping[str, Any] | None = None,
    ) -> Self:
        """Read the model of a run; `Dataset.model` does it by the run's name.

        Parameters
        ----------
        archive
            The fitted estimator's bytes, safetensors.
        fitted_scale
            The run record's `fitted_scale`.
        fitted_pooling
            Its `fitted_pooling`; None for none.

        Raises
        ------
        DamagedError
            For bytes that are no fitted estimator.
        """
        pools = FittedSingle() if fitted_pooling is None else pooling.from_json(fitted_pooling)
        return cls(load(archive), scales.from_json(fitted_scale), pools)

    def __call__(self, pairs: Pairs) -> Scored:
        """Give pairs a leverage.

        Parameters
        ----------
        pairs
            n pairs of the fitted widths. A windowVAE and a pooling look at neighboring rows of an
            episode: they must be in the same batch.

        Raises
        ------
        InvalidInputError
            For what is no pairs, or states or actions of another width.
        """
        uncertainty = self.estimator.uncertainty(pairs)
        pooled = self.pooling(uncertainty.total, pairs.episode)
        return Scored(uncertainty.total, uncertainty.parts, self.scale(pooled), pooled)
