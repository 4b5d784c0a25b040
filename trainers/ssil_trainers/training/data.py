"""What a training run learns from: demonstrations, a scoring run on them, the expert's return."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from ssil_data.store.dataset import Dataset
from ssil_data.surface import DatasetLike
from ssil_trainers.algorithms.demonstrations import Demonstrations
from ssil_trainers.training.expert_return import measure_expert_return, without_noise


@dataclass(frozen=True, eq=False)
class TrainingData:
    """Demonstrations, and what is known about them.

    Parameters
    ----------
    demonstrations:
        The pairs to learn from.
    expert_return:
        The expert's mean return without noise on its actions, which makes a score of 1; None if no
        return of the expert is known.
    recorded_return:
        The mean return that was recorded, with the noise; None if it is not known.
    identity:
        JSON that identifies the demonstrations: a checkpoint is resumed only with the same.
    scale:
        Kind of the scale that the run's leverage is by; None without a run.
    run_labeled:
        How many labeled pairs the run rests on; None without a run.

    Examples
    --------
    >>> data = TrainingData.read(dataset, "vae")
    >>> len(data.demonstrations.states), int(data.demonstrations.labeled.sum())
    (420, 120)
    >>> data.identity["dataset"], data.identity["run"], data.scale
    ('drives', 'vae', 'quantile')
    """

    demonstrations: Demonstrations
    expert_return: float | None = None
    recorded_return: float | None = None
    identity: Mapping[str, Any] = field(default_factory=dict)
    scale: str | None = None
    run_labeled: int | None = None

    @classmethod
    def read(
        cls, dataset: DatasetLike, run: str | None, *, threads: int | None = None
    ) -> TrainingData:
        """Read a dataset, and the leverage and the field of a scoring run on it.

        Parameters
        ----------
        dataset:
            The dataset, in a store or at a service.
        run:
            Name of the scoring run; None for none.
        threads:
            Threads of a field in this process; None for all processors.

        Raises
        ------
        NotFoundError
            If the dataset has no such run.
        """
        pairs = dataset.pairs()
        leverage = None
        leverage_field = None
        open_model = None
        if run is not None:
            leverage = np.asarray(dataset.leverage(run))
            options: dict[str, Any] = {"threads": threads} if isinstance(dataset, Dataset) else {}
            leverage_field = dataset.field(run, **options)
            open_model = partial(dataset.model, run)
        demonstrations = Demonstrations(
            states=pairs.states,
            actions=pairs.actions,
            labeled=dataset.per_pair("labeled").astype(bool),
            leverage=leverage,
            field=leverage_field,
            open_model=open_model,
            threads=threads,
        )
        record = None if run is None else dataset.runs[run]
        identity = {"dataset": dataset.name, "version": dataset.version, "run": run}
        recorded = measure_expert_return(dataset)
        return cls(
            demonstrations,
            expert_return=None if recorded is None else without_noise(recorded),
            recorded_return=recorded,
            identity=identity,
            scale=None if record is None else str(record.scale["kind"]),
            run_labeled=None if record is None else record.labeled,
        )
