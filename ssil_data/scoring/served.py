"""Datasets whose runs are made elsewhere, and how a caller hears of progress."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, Self, TypeVar

from ssil_data.estimators import Estimator
from ssil_data.scoring.recipes import Recipe
from ssil_data.store.run_record import Run

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""


class ServedDataset(Protocol):
    """A dataset whose runs are made elsewhere: the client's, behind a service."""

    def score(
        self,
        recipe: Recipe | Estimator,
        /,
        *,
        labels: int | None = None,
        seed: int = 0,
        run: str | None = None,
        progress: Progress | None = None,
    ) -> Run:
        """Do what `score` does, where the dataset is.

        Parameters
        ----------
        recipe, labels, seed, run, progress
            See `score`.
        """
        ...

    def rescore(
        self,
        source: Self,
        source_run: str,
        /,
        *,
        run: str | None = None,
        progress: Progress | None = None,
    ) -> Run:
        """Do what `rescore` does, where both datasets are.

        Parameters
        ----------
        source, source_run, run, progress
            See `rescore`.
        """
        ...


Served = TypeVar("Served", bound=ServedDataset)


def ignore_progress(what: str, done: int, of: int) -> None:
    """Report nothing.

    Parameters
    ----------
    what, done, of
        See `Progress`.
    """
