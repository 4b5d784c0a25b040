"""How a job makes its run: under a name of its own, in a worker process that may be cut off."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import count
from typing import Any, Literal

from ssil_data.errors import DamagedError, NotFoundError, SsilDataError
from ssil_data.store import Store
from ssil_data.store.runs import Run
from ssil_service.jobs.journal import JobRecord
from ssil_service.problems import Problem, of_library
from ssil_service.workers.pool import Pool, Report, Started, TaskError


@dataclass(frozen=True)
class Ending:
    """How a job ended, and why if it made no run."""

    state: Literal["succeeded", "failed"]
    error: Mapping[str, str] | None = None


def fault(kind: str, detail: str) -> Ending:
    """Return the ending of a job that made no run."""
    return Ending("failed", {"kind": kind, "detail": detail})


@dataclass(frozen=True)
class Runner:
    """Makes the runs of jobs in a store."""

    store: str
    pool: Pool

    def free_name(self, dataset: str, stem: str, reserved: Collection[str]) -> str:
        """Return `stem`, or the first of `stem-2`, … that no run has and no job will have.

        Raises NotFoundError where the dataset is gone.
        """
        taken = {*self._runs(dataset), *reserved}
        numbered = (stem if number == 1 else f"{stem}-{number}" for number in count(1))
        return next(name for name in numbered if name not in taken)

    def name_is_used(self, record: JobRecord) -> bool:
        """Tell whether a run has the job's name; raises NotFoundError without its dataset."""
        return record.run in self._runs(record.dataset)

    def run(self, record: JobRecord, *, report: Report, started: Started) -> Ending:
        """Make the run of a job."""
        arguments = {"store": self.store, "dataset": record.dataset, "run": record.run}
        arguments |= {"version": record.version, "body": dict(record.body)}
        try:
            self.pool.run("make_run", arguments, report=report, started=started)
        except (SsilDataError, Problem) as error:
            return self.refuse(error)
        except TaskError as error:
            return self.find_ending(record, fault(error.kind, error.detail))
        return Ending("succeeded")

    def refuse(self, error: SsilDataError | Problem) -> Ending:
        """Return the ending of a job that cannot be; no place on the machine is named."""
        kind = type(error).__name__
        if isinstance(error, SsilDataError):
            error = of_library(error, [Store(self.store).folder.uri])
        return fault(kind, error.detail)

    def find_ending(self, record: JobRecord, ending: Ending) -> Ending:
        """Return how a job ended that gave no answer: it may have made its run before that."""
        try:
            made = self._has_made_run(record)
        except DamagedError:
            made = False
        return Ending("succeeded") if made else ending

    def _has_made_run(self, record: JobRecord) -> bool:
        """Tell whether the run of the job's name is the job's, not one of somebody outside."""
        place = Store(self.store)
        try:
            run = place[record.dataset].runs.of_any_version(record.run)
            expected = expected_record(record.body, place, record.dataset)
        except NotFoundError:
            return False
        found = {name: getattr(run, name) for name in expected}
        return (run.dataset_version, found) == (record.version, expected)

    def _runs(self, dataset: str) -> list[str]:
        return Store(self.store)[dataset].runs.names()


def expected_record(body: Mapping[str, Any], place: Store, dataset: str) -> dict[str, Any]:
    """Return what the record of a run says that was made as the body of its job describes it."""
    if "fitted" not in body:
        return {name: body[name] for name in ("estimator", "scale", "labeled_is_one", "seed")}
    fitted = body["fitted"]
    source: Run = place[fitted["dataset"] or dataset].runs.of_any_version(fitted["run"])
    return {"model": source.model, "fitted_scale": source.fitted_scale}
