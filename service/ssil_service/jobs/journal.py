"""The journal of jobs: one file for each, shared by all servers of a store."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from ssil_data.store.folder import Folder
from ssil_service.logs import log_event

KEPT = 1000
"""Ended jobs that a server remembers, the newest."""

JobState = Literal["queued", "running", "succeeded", "failed", "cancelled"]
ENDED = ("succeeded", "failed", "cancelled")
_JOB_ID = re.compile(r"[0-9a-f]{16}")
_NOT_SHOWN = {"server", "version", "body", "name_prefix", "request_digest"}
"""Fields of a record that are the servers' own."""


@dataclass(frozen=True)
class JobRecord:
    """What is kept of a job.

    An alias is the key under which a field is stored, and shown to clients; where there is none,
    it is the field's name.

    Parameters
    ----------
    id
        16 hexadecimal digits.
    server
        Id of the server that runs it (`ServerLease.server`).
    dataset, version
        What is to be scored.
    body
        What is to be made, see `ssil_service.workers.tasks.make_run`.
    run_name
        Name of the run that the job is to make; no other job has it.
    name_prefix
        Beginning of that name, from which another can be found; None if the client chose the name.
    request_digest
        Digest of the request as it was sent; another request under the same key is refused.
    created, started, ended
        ISO 8601, UTC.
    state
        One of `JobState`.
    error
        `kind` and `detail` of a job that failed.
    """

    id: Annotated[str, Field(alias="job")]
    server: str
    dataset: str
    version: str
    body: Mapping[str, Any]
    run_name: Annotated[str, Field(alias="run")]
    name_prefix: Annotated[str | None, Field(alias="stem")]
    request_digest: Annotated[str, Field(alias="asked")]
    created: str
    state: JobState = "queued"
    error: Mapping[str, str] | None = None
    started: str | None = None
    ended: str | None = None

    @property
    def has_ended(self) -> bool:
        """Whether the job has ended, so that nothing of it changes any more."""
        return self.state in ENDED

    def to_json(self, progress: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return the job as clients see it.

        Parameters
        ----------
        progress
            How far it is, if this server runs it.

        Returns
        -------
        dict
            JSON object, under the stored names.
        """
        shown = _RECORD.dump_python(self, by_alias=True, exclude=_NOT_SHOWN)
        return {**shown, "progress": progress}


_RECORD = TypeAdapter(JobRecord)


class Journal:
    """Records of jobs by id, written durably; a file that holds no record is skipped and logged.

    Parameters
    ----------
    folder
        Where the files are; it is made if it does not exist.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder
        self._folder = Folder(folder)
        self._folder.make()
        self._ended: dict[str, JobRecord] = {}
        self._invalid: set[str] = set()

    def write(self, record: JobRecord) -> None:
        """Write a record, in place of the older one of its job.

        Parameters
        ----------
        record
            On the disk when this returns.

        Raises
        ------
        OSError
            If the disk refuses.
        """
        stored = _RECORD.dump_python(record, by_alias=True)
        self._folder.write(f"{record.id}.json", json.dumps(stored).encode())

    def get(self, job_id: str) -> JobRecord | None:
        """Return a job's record, whichever server wrote it.

        Parameters
        ----------
        job_id
            Any text.

        Returns
        -------
        JobRecord or None
            None if there is no such job.
        """
        known = self._ended.get(job_id)
        if known is not None:
            return known
        return self._load(job_id) if _JOB_ID.fullmatch(job_id) else None

    def all(self) -> list[JobRecord]:
        """Return all records, the oldest first."""
        stems = {path.stem for path in self._path.glob("*.json")}
        job_ids = {stem for stem in stems if _JOB_ID.fullmatch(stem)}
        for job_id in [known for known in list(self._ended) if known not in job_ids]:
            self._ended.pop(job_id, None)
        found = [record for record in map(self.get, job_ids) if record is not None]
        return sorted(found, key=lambda record: record.created)

    def forget(self, job_id: str) -> None:
        """Delete a job's record.

        Parameters
        ----------
        job_id
            The job, if there is one.
        """
        with suppress(OSError):
            (self._path / f"{job_id}.json").unlink()
        self._ended.pop(job_id, None)

    def _load(self, job_id: str) -> JobRecord | None:
        """Read a record from its file; one that has ended is kept in memory, as it is final."""
        try:
            record = _RECORD.validate_json((self._path / f"{job_id}.json").read_bytes())
            if record.id != job_id:
                raise ValueError("the record of another job")
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            self._log_invalid(job_id, error)
            return None
        if record.has_ended:
            self._ended[job_id] = record
        return record

    def _log_invalid(self, job_id: str, error: Exception) -> None:
        """Log a file that holds no record, once."""
        if job_id not in self._invalid:
            self._invalid.add(job_id)
            found = type(error).__name__
            log_event("invalid job record", level=logging.WARNING, job=job_id, found=found)
