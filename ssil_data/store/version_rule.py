"""The rule about runs and versions: a run's values belong to the version it was made from.

Its model, that is its fitted estimator and scale, may be used for any version. The local store,
the client and the service apply these two functions and no rule of their own.
"""

from __future__ import annotations

from collections.abc import Iterable

from ssil_data.errors import ConflictError
from ssil_data.store.run_record import Run


def check_version(run: Run, *, dataset: str, version: str) -> Run:
    """Return a run whose values belong to a version of its dataset.

    Parameters
    ----------
    run
        The record.
    dataset
        What the message calls the dataset.
    version
        The fingerprint that the run must have been made from.

    Returns
    -------
    Run
        The run.

    Raises
    ------
    ConflictError
        If the run was made from another version.
    """
    if run.dataset_version != version:
        raise ConflictError(
            f"run {run.name!r}: expected one made from version {version} of {dataset}, "
            f"found version {run.dataset_version}; score this version"
        )
    return run


def select_version(runs: Iterable[Run], version: str) -> list[Run]:
    """Return the runs that were made from a version, in their order.

    Parameters
    ----------
    runs
        Records of any versions.
    version
        The fingerprint.
    """
    return [run for run in runs if run.dataset_version == version]
