"""A server's lease: its own folder in the state folder, under a lock that it holds while it lives.

All servers of a store share one state folder. A server and its workers hold a shared lock on a
file of their own; where that lock is free, the server is dead, and another one, that runs or
starts, adopts its jobs and removes its files.

    STATE/jobs/           the journal of jobs (`ssil_service.jobs.journal`)
    STATE/servers/ID/     one server's lease: `lock`, and temporary files
    STATE/takeover        the lock of `ServerLease.exclusive`
"""

from __future__ import annotations

import fcntl
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ssil_data.store.folder import Folder


class ServerLease:
    """One server's folder among those of all servers of a store.

    Parameters
    ----------
    state_folder
        The folder that the servers share; it is made if it does not exist.

    Attributes
    ----------
    server
        Random id of this server, 16 hexadecimal digits.
    folder
        This server's own folder.
    lock
        The file whose lock says that the server, or one of its workers, lives.

    Raises
    ------
    OSError
        If the state folder cannot be written.
    """

    def __init__(self, state_folder: Path) -> None:
        self.state_folder = state_folder
        self.server = secrets.token_hex(8)
        self.folder = state_folder / "servers" / self.server
        self.lock = self.folder / "lock"
        Folder(state_folder).make()
        with self.exclusive():  # a server that starts now must not take this one for dead
            self.folder.mkdir(parents=True)
            self._handle = os.open(self.lock, os.O_CREAT | os.O_RDONLY, 0o600)
            fcntl.flock(self._handle, fcntl.LOCK_SH)

    @contextmanager
    def temporary_file(self) -> Iterator[Path]:
        """Give the path of a file for as long as the context lasts.

        Yields
        ------
        Path
            Unused; what was written there is deleted at the end, or by the next server if this
            one is killed.
        """
        path = self.folder / secrets.token_hex(8)
        try:
            yield path
        finally:
            path.unlink(missing_ok=True)

    @contextmanager
    def exclusive(self) -> Iterator[None]:
        """Hold the lock that all servers share; leases start and jobs are accepted under it."""
        handle = os.open(self.state_folder / "takeover", os.O_CREAT | os.O_RDONLY, 0o600)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield
        finally:
            os.close(handle)

    @contextmanager
    def adopt_orphans(self) -> Iterator[set[str]]:
        """Find the servers that live; inside the context, jobs of all others may be adopted.

        Yields
        ------
        set of str
            Ids of the servers that live, this one among them. The folders of the others are
            removed at the end.
        """
        with self.exclusive():
            folders = {each.name: each for each in (self.state_folder / "servers").iterdir()}
            living = {name for name, folder in folders.items() if self._is_alive(folder)}
            yield living
            for name in folders.keys() - living:
                shutil.rmtree(folders[name], ignore_errors=True)

    def _is_alive(self, folder: Path) -> bool:
        return folder.name == self.server or not _take_free_lock(folder / "lock")

    def close(self) -> None:
        """Remove this server's folder and release its lock."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.release()

    def release(self) -> None:
        """Release the lock and keep the folder, as the end of the process does."""
        os.close(self._handle)


def _take_free_lock(lock: Path) -> bool:
    """Remove a dead server's lock file; False if a process holds the lock."""
    try:
        handle = os.open(lock, os.O_RDONLY)
    except (FileNotFoundError, NotADirectoryError):
        return True
    except OSError:  # another user's
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        lock.unlink()  # a worker that starts only now finds no lock, and ends
        return True
    except BlockingIOError:
        return False
    finally:
        os.close(handle)
