"""A scoring job at a service: its progress, its result, and how to stop it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ssil_data.client.connection import Connection, ServiceError
from ssil_data.errors import ConflictError, InvalidInputError, NotFoundError, SsilDataError

_KINDS: dict[str, type[SsilDataError]] = {
    "ConflictError": ConflictError,
    "InvalidInputError": InvalidInputError,
    "NotFoundError": NotFoundError,
}
_POLL = 0.1


class JobFailedError(ServiceError):
    """The job ended without a run: it failed, or somebody cancelled it."""


@dataclass(frozen=True)
class RemoteJob:
    """One job by its id."""

    connection: Connection
    id: str

    def state(self) -> dict[str, Any]:
        """Return the job as the service shows it: state, progress, run, error."""
        return self.connection.json("GET", f"v1/jobs/{self.id}")

    def cancel(self) -> None:
        """Stop the job; nothing of it is kept."""
        self.connection.request("POST", f"v1/jobs/{self.id}/cancel", repeatable=True)

    def wait(self, progress: Callable[[str, int, int], None] | None = None) -> str:
        """Wait for the end and return the run's name.

        Raises the error that scoring raises locally for the caller's mistake, JobFailedError else.
        """
        told: tuple[Any, ...] = ()
        while True:
            job = self.state()
            step = job.get("progress")
            if progress is not None and step is not None:
                now = (step["what"], step["done"], step["of"])
                if now != told:
                    progress(*now)
                    told = now
            if job["state"] == "succeeded":
                return job["run"]
            if job["state"] in ("failed", "cancelled"):
                error = job.get("error") or {}
                kind = _KINDS.get(error.get("kind", ""), JobFailedError)
                raise kind(error.get("detail") or f"job {self.id}: {job['state']}")
            time.sleep(_POLL)
