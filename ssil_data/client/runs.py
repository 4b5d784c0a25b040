"""The scoring runs of a dataset at a service, as `ssil_data.store.Runs` has them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

import pyarrow as pa

from ssil_data.client.connection import Connection
from ssil_data.client.pages import read_table
from ssil_data.store.arrow_schema import VALUES
from ssil_data.store.folder import check_name
from ssil_data.store.run_record import Run
from ssil_data.store.version_rule import check_version, select_version


def run_path(dataset: str, run: str) -> str:
    """Return the path of a run at the service.

    Parameters
    ----------
    dataset
        The dataset's name.
    run
        The run's name.

    Raises
    ------
    InvalidInputError
        For a name that no run can have.
    """
    return f"v1/datasets/{dataset}/runs/{check_name('run', run)}"


class RemoteRuns:
    """The runs of one dataset, by name, as one version of it sees them.

    Parameters
    ----------
    connection
        To the service.
    dataset
        The dataset's name.
    version
        The fingerprint of the version.

    Examples
    --------
    >>> remote["drives"].runs.names()
    ['vae']
    >>> remote["drives"].runs["vae"] == dataset.runs["vae"]
    True
    """

    def __init__(self, connection: Connection, dataset: str, version: str) -> None:
        self._connection = connection
        self._dataset = dataset
        self._version = version

    def all(self) -> list[Run]:
        """List the runs of every version of the dataset, oldest first."""
        listed = self._connection.json("GET", f"v1/datasets/{self._dataset}/runs")
        return [_read_run(record) for record in listed["runs"]]

    def __iter__(self) -> Iterator[Run]:
        """Go through the runs of this version, oldest first."""
        return iter(select_version(self.all(), self._version))

    def __getitem__(self, name: str) -> Run:
        """Return the record of a run of this version.

        Parameters
        ----------
        name
            The run's name.

        Raises
        ------
        NotFoundError
            If no run has the name.
        ConflictError
            If the run was made from another version.
        """
        run = self.of_any_version(name)
        return check_version(run, dataset=self._dataset, version=self._version)

    def names(self) -> list[str]:
        """List the names of the runs of every version, sorted."""
        return sorted(run.name for run in self.all())

    def of_any_version(self, name: str) -> Run:
        """Return the record of a run whose model is to be used, not its values.

        Parameters
        ----------
        name
            The run's name.

        Raises
        ------
        NotFoundError
            If no run has the name.
        """
        return _read_run(self._connection.json("GET", run_path(self._dataset, name)))

    def values(self, name: str) -> pa.Table:
        """Read a run's values in the order of the pairs.

        Parameters
        ----------
        name
            The run's name.

        Returns
        -------
        pyarrow.Table
            The columns of the local store's: episode, step, uncertainty, its parts aleatoric and
            epistemic, leverage in [0, 1], the uncertainty pooled over time, and the members of an
            ensemble; null where the run has none.

        Raises
        ------
        NotFoundError
            If no run has the name.
        ConflictError
            If the run was made from another version.
        """
        path = f"{run_path(self._dataset, name)}/leverage"
        return read_table(self._connection, path, self._version, {"columns": VALUES.names}).cast(
            VALUES
        )


def _read_run(record: Mapping[str, Any]) -> Run:
    """Read a record, without what a newer service may say of a run."""
    known = {"run", *(field.name for field in fields(Run))}
    return Run.from_json({name: value for name, value in record.items() if name in known})
