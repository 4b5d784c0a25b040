"""Fits: the scoring runs that training needs, on working copies of the demonstrations.

The store that the demonstrations come from is only read.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from ssil_data.errors import InvalidInputError
from ssil_data.scoring import preset, score
from ssil_data.store import Store
from ssil_trainers.experiments.provenance import code_digest
from ssil_trainers.training.label_subset import limit_labels


@dataclass(frozen=True)
class Fit:
    """A scoring run in a working store, and how it is made.

    Parameters
    ----------
    store:
        Location of the working store.
    dataset:
        Name of the dataset in it.
    estimator:
        Name of the estimator.
    preset:
        Name of the preset: which scale and options go with the estimator.
    seed:
        Seed of the fit.
    run:
        Name of the run.
    """

    store: str
    dataset: str
    estimator: str
    preset: str
    seed: int
    run: str

    @classmethod
    def of(cls, store: Store, dataset: str, *, estimator: str, preset: str, seed: int) -> Fit:
        """Name the run after everything that makes it, the code included.

        A run that other code made has another name, and is never taken for this one.

        Parameters
        ----------
        store:
            The working store.
        dataset:
            Name of the dataset in it.
        estimator:
            Name of the estimator.
        preset:
            Name of the preset.
        seed:
            Seed of the fit.
        """
        run = f"{estimator}-{preset}-seed-{seed}-{code_digest()}"
        return cls(store.folder.uri, dataset, estimator, preset, seed, run)

    @property
    def name(self) -> str:
        """The name in progress lines."""
        return f"{self.estimator} {self.preset} on {self.dataset}, seed {self.seed}"

    def is_made(self) -> bool:
        """Return whether the run exists."""
        return self.run in Store(self.store)[self.dataset].runs.names()

    def __call__(self) -> None:
        """Make the run unless it exists."""
        if not self.is_made():
            recipe = preset(self.preset, self.estimator)
            score(Store(self.store)[self.dataset], recipe, seed=self.seed, run=self.run)


def copy_dataset(source: Store, name: str, work: Path) -> Store:
    """Copy a dataset into a working store of its own, once for each version.

    A copy that was changed since is made again.

    Parameters
    ----------
    source:
        The store to copy from, in a local folder.
    name:
        Name of the dataset.
    work:
        Folder of the working stores.

    Returns
    -------
    :
        The working store.

    Raises
    ------
    InvalidInputError
        If the source is not a local folder.
    """
    dataset = source[name]
    store = Store(work / f"{name}-{dataset.version}")
    if name in store and store[name].version == dataset.version:
        return store
    folder = dataset.folder.local
    if folder is None or store.folder.local is None:
        raise InvalidInputError(
            f"store: only a local folder can be copied, not {source.folder.uri}"
        )
    work.mkdir(parents=True, exist_ok=True)
    (work / ".gitignore").write_text("*\n")
    hidden = store.folder.local.with_name(f".{store.folder.local.name}")
    shutil.rmtree(hidden, ignore_errors=True)
    shutil.copytree(folder, hidden / name)
    shutil.rmtree(store.folder.local, ignore_errors=True)
    hidden.rename(store.folder.local)
    return store


def limit_dataset(store: Store, name: str, labels: int | None) -> str:
    """Make the dataset with so many labels unless it exists, and return its name.

    Parameters
    ----------
    store:
        The working store.
    name:
        Name of the dataset.
    labels:
        Number of labeled pairs to keep; None for all.
    """
    return name if labels is None else limit_labels(store, name, labels).name
