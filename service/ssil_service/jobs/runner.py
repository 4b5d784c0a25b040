"""How a job makes its run: under a name of its own, in a worker process that may be killed."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import count
from typing import Any, Literal

from ssil_data.errors import DamagedError, NotFoundError, SsilDataError
from ssil_data.store import Store
from ssil_data.store.run_record import Run
from ssil_service.jobs.journal import JobRecord
from ssil_service.problems import Problem, of_library
from ssil_service.workers.pool import AssignWorker, Pool
from ssil_service.workers.worker import Report, TaskError


@dataclass(frozen=True)
class Ending:
    """How a job ended, with `kind` and `detail` of the error if it made no run."""

    state: Literal["succeeded", "failed"]
    error: Mapping[str, str] | None = None

    @classmethod
    def of_error(cls, kind: str, detail: str) -> Ending:
        """Return the ending of a job that failed.

        Parameters
        ----------
        kind
            Name of the error, which clients may branch on.
        detail
            A sentence for people.
        """
        return cls("failed", {"kind": kind, "detail": detail})


@dataclass(frozen=True)
class Runner:
    """Makes the runs of jobs.

    Parameters
    ----------
    store
        Folder or URI of the store.
    pool
        Workers that fit and score.
    """

    store: str
    pool: Pool

    def find_free_name(self, dataset: str, prefix: str, reserved: Collection[str]) -> str:
        """Find a name for a run.

        Parameters
        ----------
        dataset
            Whose run it is.
        prefix
            The name to begin with.
        reserved
            Names that other jobs will use.

        Returns
        -------
        str
            `prefix`, or the first of `prefix-2`, `prefix-3`, … that is free.

        Raises
        ------
        NotFoundError
            If there is no such dataset.
        """
        used = {*self._run_names(dataset), *reserved}
        numbered = (prefix if number == 1 else f"{prefix}-{number}" for number in count(1))
        return next(name for name in numbered if name not in used)

    def name_is_used(self, record: JobRecord) -> bool:
        """Return whether a run has the job's name.

        Parameters
        ----------
        record
            The job.

        Raises
        ------
        NotFoundError
            If its dataset is gone.
        """
        return record.run_name in self._run_names(record.dataset)

    def run(self, record: JobRecord, *, report: Report, assign_worker: AssignWorker) -> Ending:
        """Make the run of a job.

        Parameters
        ----------
        record
            The job.
        report, assign_worker
            See `Pool.run`.

        Returns
        -------
        Ending
            Whatever happens to the worker.
        """
        arguments = {
            "store": self.store,
            "dataset": record.dataset,
            "version": record.version,
            "run": record.run_name,
            "body": dict(record.body),
        }
        try:
            self.pool.run("make_run", arguments, report=report, assign_worker=assign_worker)
        except (SsilDataError, Problem) as error:
            return self.explain(error)
        except TaskError as error:
            return self.find_ending(record, Ending.of_error(error.kind, error.detail))
        return Ending("succeeded")

    def explain(self, error: SsilDataError | Problem) -> Ending:
        """Return the ending of a job that was refused.

        Parameters
        ----------
        error
            Why; paths of this machine in its message are replaced.
        """
        kind = type(error).__name__
        if isinstance(error, SsilDataError):
            error = of_library(error, [Store(self.store).folder.uri])
        return Ending.of_error(kind, error.detail)

    def find_ending(self, record: JobRecord, failure: Ending) -> Ending:
        """Find out how a job ended whose worker gave no answer.

        Parameters
        ----------
        record
            The job.
        failure
            Its ending, unless it made its run before the worker died.
        """
        try:
            made = self._has_made_run(record)
        except DamagedError:
            made = False
        return Ending("succeeded") if made else failure

    def _has_made_run(self, record: JobRecord) -> bool:
        """Tell whether the run of that name is the job's, and not one that another user made."""
        store = Store(self.store)
        try:
            run = store[record.dataset].runs.of_any_version(record.run_name)
            expected = build_expected_record(record.body, store, record.dataset)
        except NotFoundError:
            return False
        found = {name: getattr(run, name) for name in expected}
        return run.dataset_version == record.version and found == expected

    def _run_names(self, dataset: str) -> list[str]:
        return Store(self.store)[dataset].runs.names()


def build_expected_record(body: Mapping[str, Any], store: Store, dataset: str) -> dict[str, Any]:
    """Return what the record of a run must say that was made as a job's body describes.

    Parameters
    ----------
    body
        Of the job, see `ssil_service.workers.tasks.make_run`.
    store
        The store.
    dataset
        The job's dataset.

    Returns
    -------
    dict
        Attributes of `ssil_data.store.run_record.Run` with their values.
    """
    if "fitted" not in body:
        first = {name: body[name] for name in ("estimator", "scale", "labeled_is_one", "seed")}
        later = {name: value for name, value in body.items() if name not in {*first, "labels"}}
        labels = body.get("labels")
        return {**first, **later, **({} if labels is None else {"labeled": labels})}
    fitted = body["fitted"]
    source: Run = store[fitted["dataset"] or dataset].runs.of_any_version(fitted["run"])
    return {"model": source.model, "fitted_scale": source.fitted_scale}
