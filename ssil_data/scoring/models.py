"""A run's model, which gives any pair a leverage, and what it gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ssil_data import scales
from ssil_data.demonstrations import Pairs
from ssil_data.estimators import Fitted, load
from ssil_data.scales import FittedScale
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run


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
    >>> model = sd.LeverageModel.of(dataset, "vae")
    >>> scored = model(dataset.episode(0))
    >>> bool(np.array_equal(scored.leverage, dataset.leverage("vae")[: len(scored.leverage)]))
    True
    """

    estimator: Fitted
    scale: FittedScale

    @classmethod
    def of(cls, dataset: Dataset, run: str) -> LeverageModel:
        """Load the model of a run of any version.

        Parameters
        ----------
        dataset
            The dataset that was scored.
        run
            The run's name.

        Raises
        ------
        NotFoundError
            If no run has the name.
        DamagedError
            Where bytes are not those that were written.
        """
        return cls.of_record(dataset, dataset.runs.of_any_version(run))

    @classmethod
    def of_record(cls, dataset: Dataset, record: Run) -> LeverageModel:
        """Load the model of a run whose record was read already.

        Parameters
        ----------
        dataset
            The dataset that was scored.
        record
            The run's record.

        Raises
        ------
        DamagedError
            Where bytes are not those that were written.
        """
        return cls(load(dataset.runs.model(record)), scales.from_json(record.fitted_scale))

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
