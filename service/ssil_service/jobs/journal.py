"""The journal of jobs: what is kept of each, one file each, by all servers of a store."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter

from ssil_data.store.folder import Folder
from ssil_service.logs import log_event

KEPT = 1000
"""Ended jobs that are remembered, the newest."""

JobState = Literal["queued", "running", "succeeded", "failed", "cancelled"]
ENDED = ("succeeded", "failed", "cancelled")
_JOB = re.compile(r"[0-9a-f]{16}")


@dataclass(frozen=True)
class JobRecord:
    """A job as it is journalled; times are ISO 8601 in UTC."""

    job: str
    server: str
    dataset: str
    version: str
    body: Mapping[str, Any]
    run: str
    """The name of the run that it is to make, which is the job's alone."""
    stem: str | None
    """The beginning of that name, None if the client chose the name."""
    asked: str
    """A digest of the request as it was sent: another under the same key is refused."""
    created: str
    state: JobState = "queued"
    error: Mapping[str, str] | None = None
    started: str | None = None
    ended: str | None = None

    @property
    def over(self) -> bool:
        """Whether the job has ended; nothing of it changes any more."""
        return self.state in ENDED

    def as_shown(self, progress: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return what clients see."""
        hidden = ("server", "version", "body", "stem", "asked")
        known = {name: value for name, value in asdict(self).items() if name not in hidden}
        return {**known, "progress": progress}


_RECORD = TypeAdapter(JobRecord)


class Journal:
    """Records of jobs by their number, written durably; what is no record is left out."""

    def __init__(self, folder: Path) -> None:
        """Open the journal; raises OSError where the folder cannot be written."""
        self._place = folder
        self._folder = Folder(folder)
        self._folder.make()
        self._ended: dict[str, JobRecord] = {}
        self._odd: set[str] = set()

    def write(self, record: JobRecord) -> None:
        """Keep a record; raises OSError where the disk refuses."""
        self._folder.write(f"{record.job}.json", json.dumps(asdict(record)).encode())

    def read(self, job: str) -> JobRecord | None:
        """Return a job's record, whichever server wrote it, or None."""
        known = self._ended.get(job)
        return known or (self._read(job) if _JOB.fullmatch(job) else None)

    def all(self) -> list[JobRecord]:
        """Return all records, the oldest first."""
        jobs = {path.stem for path in self._place.glob("*.json") if _JOB.fullmatch(path.stem)}
        for gone in [job for job in list(self._ended) if job not in jobs]:
            self._ended.pop(gone, None)
        found = [record for record in map(self.read, jobs) if record is not None]
        return sorted(found, key=lambda record: record.created)

    def forget(self, job: str) -> None:
        """Delete a job's record."""
        with suppress(OSError):
            (self._place / f"{job}.json").unlink()
        self._ended.pop(job, None)

    def _read(self, job: str) -> JobRecord | None:
        try:
            record = _RECORD.validate_json((self._place / f"{job}.json").read_bytes())
            if record.job != job:
                raise ValueError
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as error:
            if job not in self._odd:
                self._odd.add(job)
                found = type(error).__name__
                log_event("no record of a job", level=logging.WARNING, job=job, found=found)
            return None
        if record.over:
            self._ended[job] = record
        return record
