"""The service's own folder: which servers live, the journal of their jobs, files under way.

A server and its workers hold a lock for as long as they live. What belongs to a server whose lock
is free is taken over by the next one that starts.
"""

from __future__ import annotations

import fcntl
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ssil_service.jobs.journal import Journal


class ServerLease:
    """One server's place in the folder that all servers of a store share."""

    def __init__(self, folder: Path) -> None:
        """Take a place; raises OSError where the folder cannot be written."""
        self.folder = folder
        self.server = secrets.token_hex(8)
        self.journal = Journal(folder / "jobs")
        self.place = folder / "servers" / self.server
        self.lock = self.place / "lock"
        with self.exclusive():  # or a server that starts now would take it for a dead one's
            self.place.mkdir(parents=True)
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

    @contextmanager
    def exclusive(self) -> Iterator[None]:
        """Hold the lock under which places are taken and jobs accepted, of all servers' one."""
        guard = os.open(self.folder / "takeover", os.O_CREAT | os.O_RDONLY, 0o600)
        try:
            fcntl.flock(guard, fcntl.LOCK_EX)
            yield
        finally:
            os.close(guard)

    @contextmanager
    def adopt_orphans(self) -> Iterator[set[str]]:
        """Give the servers that live; the others' jobs may be taken, their places are gone then."""
        with self.exclusive():
            places = {each.name: each for each in (self.folder / "servers").iterdir()}
            living = {name for name, place in places.items() if self._lives(place)}
            yield living
            for name in places.keys() - living:
                shutil.rmtree(places[name], ignore_errors=True)

    def _lives(self, place: Path) -> bool:
        return place.name == self.server or _lives(place / "lock")

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
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:  # another user's
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        lock.unlink()  # a worker that starts only now finds no lock, and ends
        return False
    except BlockingIOError:
        return True
    finally:
        os.close(handle)
