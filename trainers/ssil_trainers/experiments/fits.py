"""The working store: copies of the demonstrations, with fewer labels, and the runs on them.

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
    """A scoring run: its dataset in the working store, and how it is made."""

    store: str
    dataset: str
    estimator: str
    preset: str
    seed: int
    run: str

    @classmethod
    def of(cls, store: str, dataset: str, estimator: str, preset: str, seed: int) -> Fit:
        """Name the run by what makes it, so that one of other code is never taken for it."""
        run = f"{estimator}-{preset}-seed-{seed}-{code_digest()}"
        return cls(store, dataset, estimator, preset, seed, run)

    @property
    def name(self) -> str:
        """What a progress line calls it."""
        return f"{self.estimator} {self.preset} on {self.dataset}, seed {self.seed}"

    def is_made(self) -> bool:
        """Tell whether the run is there."""
        return self.run in Store(self.store)[self.dataset].runs.names()

    def __call__(self) -> None:
        """Make the run if it was not made before."""
        if not self.is_made():
            recipe = preset(self.preset, self.estimator)
            score(Store(self.store)[self.dataset], recipe, seed=self.seed, run=self.run)


def copy_dataset(source: Store, name: str, work: Path) -> Store:
    """Copy a dataset into a store of its own below `work`, once for each version.

    A copy that somebody changed since is made again.
    """
    dataset = source[name]
    store = Store(work / f"{name}-{dataset.version}")
    if name in store and store[name].version == dataset.version:
        return store
    folder = dataset.folder.local
    if folder is None or store.folder.local is None:
        raise InvalidInputError(f"store: expected a local folder, found {source.folder.uri}")
    work.mkdir(parents=True, exist_ok=True)
    (work / ".gitignore").write_text("*\n")
    hidden = store.folder.local.with_name(f".{store.folder.local.name}")
    shutil.rmtree(hidden, ignore_errors=True)
    shutil.copytree(folder, hidden / name)
    shutil.rmtree(store.folder.local, ignore_errors=True)
    hidden.rename(store.folder.local)
    return store


def limit_dataset(store: Store, name: str, labels: int | None) -> str:
    """Return the name of the dataset with so many labels, which is made if it must be."""
    return name if labels is None else limit_labels(store, name, labels).name
