"""One version of a dataset and its runs, as a request sees them from beginning to end."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from ssil_data.errors import NotFoundError
from ssil_data.store.dataset import Dataset
from ssil_data.store.run_record import Run
from ssil_data.store.version_rule import check_version

_NAMED = 20
"""Runs that a message names at most."""


@dataclass(frozen=True)
class Snapshot:
    """One version of a dataset, and its runs at one moment.

    Attributes
    ----------
    dataset
        The version.
    runs
        The runs of all versions, by name.
    """

    dataset: Dataset
    runs: dict[str, Run]

    @classmethod
    def of(cls, dataset: Dataset) -> Snapshot:
        """Read the runs of a dataset.

        Parameters
        ----------
        dataset
            The version; what it reads late otherwise is read now, in the thread that calls this.

        Returns
        -------
        Snapshot
            With the runs as they are now.
        """
        _ = dataset.version, dataset.episodes
        return cls(dataset, {run.name: run for run in dataset.runs.all()})

    @property
    def name(self) -> str:
        """The dataset's name."""
        return self.dataset.name

    @cached_property
    def version(self) -> str:
        """The version's fingerprint."""
        return self.dataset.version

    @cached_property
    def widths(self) -> tuple[int, int]:
        """The dimensions of a state and of an action."""
        return len(self.dataset.state_names), len(self.dataset.action_names)

    def run(self, name: str) -> Run:
        """Return a run that was made from this version, as its values need it.

        Parameters
        ----------
        name
            The run's.

        Returns
        -------
        Run
            Its record.

        Raises
        ------
        NotFoundError
            If the dataset has no such run.
        ConflictError
            If it was made from another version.
        """
        record = self.run_of_any_version(name)
        return check_version(record, dataset=self.name, version=self.version)

    def run_of_any_version(self, name: str) -> Run:
        """Return a run, whose model may be used for any version.

        Parameters
        ----------
        name
            The run's.

        Returns
        -------
        Run
            Its record.

        Raises
        ------
        NotFoundError
            If the dataset has no such run.
        """
        if name not in self.runs:
            have = ", ".join(sorted(self.runs)[:_NAMED]) or "none"
            raise NotFoundError(f"run of {self.name}: expected one of [{have}], found another")
        return self.runs[name]

    def check_run(self, name: str, *, any_version: bool = False) -> None:
        """Raise what `run` would raise, before a body is read for nothing.

        Parameters
        ----------
        name
            The run's.
        any_version
            Whether a run of another version will do.

        Raises
        ------
        NotFoundError
            If the dataset has no such run.
        ConflictError
            If it was made from another version and that will not do.
        """
        if any_version:
            self.run_of_any_version(name)
        else:
            self.run(name)
