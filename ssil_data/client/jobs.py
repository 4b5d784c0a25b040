"""A scoring job at a service: its progress, its result, and how to stop it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ssil_data.client.connection import Connection, ServiceError
from ssil_data.client.error_kinds import caller_error

POLL_SECONDS = 0.1
"""How often a job that is waited for is looked at."""


class JobFailedError(ServiceError):
    """The job ended without a run: it failed, or it was canceled.

    Examples
    --------
    >>> from ssil_data.client import JobFailedError
    >>> issubclass(JobFailedError, sd.ServiceError)
    True
    """


@dataclass(frozen=True)
class RemoteJob:
    """A scoring job at a service.

    Parameters
    ----------
    connection
        To the service.
    id
        The job's id, 16 hexadecimal digits.

    Examples
    --------
    >>> job = remote["drives"].start({"estimator": {"kind": "vae", "steps": 20}, "run": "by-job"})
    >>> job.wait()
    'by-job'
    >>> job.state()["state"]
    'succeeded'
    """

    connection: Connection
    id: str

    def state(self) -> dict[str, Any]:
        """Return the job as the service shows it.

        Returns
        -------
        dict
            Among others `state` (queued, running, succeeded, failed, cancelled), `progress`, the
            name of the `run` it makes, and its `error`.

        Raises
        ------
        NotFoundError
            If the service has forgotten the job.
        """
        return self.connection.json("GET", f"v1/jobs/{self.id}")

    def cancel(self) -> None:
        """Stop the job; nothing of it is kept.

        Raises
        ------
        ConflictError
            If another server of the store runs the job.
        NotFoundError
            If the service has forgotten the job.
        """
        self.connection.request("POST", f"v1/jobs/{self.id}/cancel", repeatable=True)

    def wait(self, progress: Callable[[str, int, int], None] | None = None) -> str:
        """Wait for the end and return the run's name.

        Parameters
        ----------
        progress
            Called at every change with what is being done, how much is done, and how much there is.

        Returns
        -------
        str
            The name of the run that the job made.

        Raises
        ------
        SsilDataError
            The error that scoring raises locally for the caller's mistake.
        JobFailedError
            For any other failure, and for a job that was canceled.
        """
        reported: tuple[Any, ...] | None = None
        while True:
            job = self.state()
            step = job.get("progress")
            if progress is not None and step is not None:
                now = (step["what"], step["done"], step["of"])
                if now != reported:
                    progress(*now)
                    reported = now
            if job["state"] == "succeeded":
                return job["run"]
            if job["state"] in ("failed", "cancelled"):
                raise self._failure(job)
            time.sleep(POLL_SECONDS)

    def _failure(self, job: dict[str, Any]) -> Exception:
        """Return why a job made no run, as an error to raise."""
        error = job.get("error") or {}
        detail = error.get("detail") or f"job {self.id}: {job['state']}"
        return caller_error(error.get("kind", ""), detail) or JobFailedError(detail)
