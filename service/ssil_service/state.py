"""The service's own folder: which servers live, the journal of their jobs, files under way.

A server and its workers hold a lock for as long as they live. What belongs to a server whose lock
is free is taken over by the next one that starts.
"""

from __future__ import annotations

import fcntl
import json
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ssil_data.storage import Folder

KEPT = 1000
"""Finished jobs that are remembered."""


class State:
    """One server's place in the folder that all servers of a store share."""

    def __init__(self, folder: Path) -> None:
        """Take a place; raises OSError where the folder cannot be written."""
        self.folder = folder
        self.server = secrets.token_hex(8)
        self._jobs = Folder(folder / "jobs")
        self._jobs.make()
        self.place = folder / "servers" / self.server
        self.place.mkdir(parents=True)
        self.lock = self.place / "lock"
        self._handle = os.open(self.lock, os.O_CREAT | os.O_RDONLY, 0o600)
        fcntl.flock(self._handle, fcntl.LOCK_SH)

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Give the name of a file that is gone afterwards, at the latest with this server."""
        path = self.place / secrets.token_hex(8)
        try:
            yield path
        finally:
            path.unlink(missing_ok=True)

    def write(self, job: str, record: dict[str, Any]) -> None:
        """Keep a job's record durably."""
        self._jobs.write(f"{job}.json", json.dumps(record).encode())

    def read(self, job: str) -> dict[str, Any] | None:
        """Return a job's record, whichever server wrote it, or None."""
        try:
            return json.loads((self.folder / "jobs" / f"{job}.json").read_bytes())
        except (FileNotFoundError, ValueError):
            return None

    def records(self) -> list[dict[str, Any]]:
        """Return all jobs' records."""
        names = [path.stem for path in (self.folder / "jobs").glob("[0-9a-f]*.json")]
        return [record for record in map(self.read, names) if record is not None]

    def forget(self, finished: list[str]) -> None:
        """Delete the records of finished jobs, oldest first, but for the last thousand."""
        for job in finished[:-KEPT]:
            (self.folder / "jobs" / f"{job}.json").unlink(missing_ok=True)

    @contextmanager
    def orphans(self) -> Iterator[set[str]]:
        """Give the servers that live no more; their places are gone afterwards."""
        guard = os.open(self.folder / "takeover", os.O_CREAT | os.O_RDONLY, 0o600)
        try:
            fcntl.flock(guard, fcntl.LOCK_EX)
            dead = {
                place.name
                for place in (self.folder / "servers").iterdir()
                if place.name != self.server and not _lives(place / "lock")
            }
            yield dead
            for name in dead:
                shutil.rmtree(self.folder / "servers" / name, ignore_errors=True)
        finally:
            os.close(guard)

    def close(self) -> None:
        """Give the place up."""
        shutil.rmtree(self.place, ignore_errors=True)
        self.release()

    def release(self) -> None:
        """Let the lock go, as the end of the process does."""
        os.close(self._handle)


def _lives(lock: Path) -> bool:
    try:
        handle = os.open(lock, os.O_RDONLY)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        lock.unlink()  # a worker that starts only now finds no lock, and ends
        return False
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
