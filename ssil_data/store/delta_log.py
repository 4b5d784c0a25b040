"""The log of a Delta table on disk: synced before a commit is acknowledged, checked when opened.

A commit is acknowledged when its files, its log entry, their folders and the entry's digest (see
`acknowledged`) are on the disk. An entry that a power cut left empty or cut off was never
acknowledged: readers open the version before it, and the next writer sets it aside.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from ssil_data.errors import DamagedError
from ssil_data.store.acknowledged import LOG, find_log_damage, read_record, write_record
from ssil_data.store.checkpoint import EVERY, write_checkpoint
from ssil_data.store.folder import Folder, sync

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


def acknowledge(table: Path, version: int) -> None:
    """Put a table's log on the disk and keep its digests: from now on it may not change.

    Parameters
    ----------
    table
        The table's folder.
    version
        The commit that is to be acknowledged.
    """
    with lock_log(table):
        sync_log(table)
        if version and version % EVERY == 0:
            with suppress(OSError):  # without it opening takes longer, and the commit is whole
                write_checkpoint(table, version)
        write_record(table, keep=read_record(table))


def find_readable(table: Path, version: int | None = None) -> int | None:
    """Check the log of a table and say which version can be opened; nothing is written.

    Parameters
    ----------
    table
        The table's folder.
    version
        The wanted one, None for the newest.

    Returns
    -------
    int or None
        None where the log is whole, so that the newest can be opened; else the wanted version, or
        the one before an entry that was never acknowledged and is torn.

    Raises
    ------
    DamagedError
        If what was acknowledged is gone or has other bytes, or if nothing tells whether a torn
        entry was.
    """
    record = read_record(table)
    if record is not None:
        damage = find_log_damage(table, record, version=version)
        if damage:
            raise DamagedError("; ".join(damage))
    torn = _find_torn(table, record or {})
    if version is not None or torn is None:
        return version
    if record is None:
        raise DamagedError(
            f"{torn}: the newest log entry is cut off or damaged, and nothing tells whether it was "
            "acknowledged; `ssil-data validate --repair` sets it aside"
        )
    return int(torn.stem) - 1


def set_torn_aside(table: Path, *, unproven: bool = False) -> Path | None:
    """Rename the newest log entry if it is torn and was never acknowledged, so that one can write.

    Judged and renamed under a lock, so that no process renames the whole entry that took its place.

    Parameters
    ----------
    table
        The table's folder.
    unproven
        Whether to do so in a table without a record of what was acknowledged, too.

    Returns
    -------
    Path or None
        The entry's new name.

    Raises
    ------
    DamagedError
        If the entry is torn and cannot be renamed.
    """
    record = read_record(table)
    if (record is None and not unproven) or _find_torn(table, record or {}) is None:
        return None
    try:
        with lock_log(table):
            torn = _find_torn(table, read_record(table) or {})
            if torn is None:
                return None
            aside = torn.rename(torn.with_name(f"{torn.stem}.{secrets.token_hex(4)}.torn"))
            sync(table / LOG)
    except OSError as error:
        raise DamagedError(
            f"{table}: the newest log entry is cut off and cannot be set aside ({error})"
        ) from None
    return aside


@contextmanager
def lock_log(table: Path) -> Iterator[None]:
    """Hold the lock of a log's torn entries and of the record of what was acknowledged.

    Parameters
    ----------
    table
        The table's folder.
    """
    try:
        import fcntl
    except ImportError:  # a system without it has one writer at a time
        yield
        return
    handle = os.open(table / LOG, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _find_torn(table: Path, record: Mapping[str, str]) -> Path | None:
    """Return the newest entry if it is torn and no digest of it was kept."""
    entries = sorted((table / LOG).glob("[0-9]*.json"))
    is_torn = entries and entries[-1].name not in record and not _is_whole(entries[-1])
    return entries[-1] if is_torn else None


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
