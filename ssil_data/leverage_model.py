"""A run's model, which gives any pair a leverage, and what it gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ssil_data import scales
from ssil_data.demonstrations import Pairs
from ssil_data.estimators import Fitted, load
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
    """

    uncertainty: NDArray[np.float32]
    parts: Mapping[str, NDArray[np.float32]]
    leverage: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class LeverageModel:
    """A fitted estimator with its fitted scale: gives leverage to pairs, scored before or not.

    Parameters
    ----------
    estimator
        From pairs to uncertainty.
    scale
        From uncertainty to leverage.

    Examples
    --------
    >>> model = dataset.model("vae")
    >>> scored = model(dataset.episode(0))
    >>> bool(np.array_equal(scored.leverage, dataset.leverage("vae")[: len(scored.leverage)]))
    True
    """

    estimator: Fitted
    scale: FittedScale

    @classmethod
    def from_archive(cls, archive: bytes, fitted_scale: Mapping[str, Any]) -> Self:
        """Read the model of a run; `Dataset.model` does it by the run's name.

        Parameters
        ----------
        archive
            The fitted estimator's bytes, safetensors.
        fitted_scale
            The run record's `fitted_scale`.

        Raises
        ------
        DamagedError
            For bytes that are no fitted estimator.
        """
        return cls(load(archive), scales.from_json(fitted_scale))

    def __call__(self, pairs: Pairs) -> Scored:
        """Give pairs a leverage.

        Parameters
        ----------
        pairs
            n pairs of the fitted widths. A windowVAE looks at neighboring rows of an episode: they
            must be in the same batch.

        Raises
        ------
        InvalidInputError
            For states or actions of another width.
        """
        uncertainty = self.estimator.uncertainty(pairs)
        return Scored(uncertainty.total, uncertainty.parts, self.scale(uncertainty.total))
