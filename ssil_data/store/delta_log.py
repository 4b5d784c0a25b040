"""The log of a Delta table on disk: synced before a commit is acknowledged, mended when opened.

A commit is acknowledged when its files, its log entry and their folders are on the disk. An entry
that a power cut left empty or cut off was never acknowledged, and is moved away on opening.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path

from ssil_data.errors import DamagedError
from ssil_data.store.folder import Folder, sync

LOG = "_delta_log"
"""The folder of the entries, one file for each commit."""

ADDED = "ssilDataAdded"
"""Key of an entry's first line that says how many files the commit adds."""

_synced: dict[Path, frozenset[tuple[str, int, int]]] = {}
"""Of each log: the files that this process has synced, by name, inode and modification time."""


def sync_log(table: Path) -> None:
    """Put a table's log on the disk: an entry needs those before it, also other processes'.

    A process syncs each file once, so that a commit costs the same however long the log is. A file
    that another process wrote meanwhile, or that took another's place, is new to this one.

    Parameters
    ----------
    table
        The table's folder.
    """
    log = table / LOG
    known = _synced.get(log, frozenset())
    found: set[tuple[str, int, int]] = set()
    with os.scandir(log) as entries:
        for entry in entries:
            with suppress(FileNotFoundError):
                stat = entry.stat()
                identity = (entry.name, stat.st_ino, stat.st_mtime_ns)
                if identity not in known:
                    sync(Path(entry.path))
                found.add(identity)
    sync(log)
    sync(table)
    _synced[log] = frozenset(found)


def forget_location(log: Folder) -> None:
    """Take out of a new log's first entry where on the machine the table was created.

    Parameters
    ----------
    log
        The folder of the entries.
    """
    name = f"{0:020d}.json"
    entries = [json.loads(line) for line in log.read(name).splitlines()]
    entries[0]["commitInfo"]["operationParameters"].pop("location", None)
    log.write(name, "\n".join(map(json.dumps, entries)).encode())


def move_torn_entry(folder: Folder) -> None:
    """Rename the newest log entry if it is empty or cut off: it was never acknowledged.

    Judged and renamed under a lock, so that no process renames the whole entry that took its place.

    Parameters
    ----------
    folder
        The table's folder.

    Raises
    ------
    DamagedError
        If the entry is torn and cannot be renamed.
    """
    if folder.local is None or _newest_torn(folder.local) is None:
        return
    import fcntl  # a power cut on a system without it is left to be reported as damage

    lock = os.open(folder.local / LOG, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        torn = _newest_torn(folder.local)
        if torn is not None:
            torn.rename(torn.with_suffix(".torn"))
            os.fsync(lock)
    except OSError as error:
        raise DamagedError(
            f"{folder.uri}: the newest log entry is cut off and cannot be moved away ({error})"
        ) from None
    finally:
        os.close(lock)


def _newest_torn(folder: Path) -> Path | None:
    entries = sorted((folder / LOG).glob("[0-9]*.json"))
    return entries[-1] if entries and not _is_whole(entries[-1]) else None


def _is_whole(entry: Path) -> bool:
    """Say whether all lines of a log entry are JSON and as many as its writer promised."""
    try:
        actions = [json.loads(line) for line in entry.read_text().splitlines()]
        added = actions[0].get("commitInfo", {}).get(ADDED) if actions else None
    except (ValueError, AttributeError):
        return False
    except FileNotFoundError:
        return True
    if not actions:
        return False
    kinds = [kind for action in actions for kind in action]
    return added is None or (kinds.count("add"), kinds.count("txn")) == (added, 1)
