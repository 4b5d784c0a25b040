"""What was acknowledged, and what its bytes were: digests beside the files.

Before a commit is acknowledged, the digest of its log entry is on the disk beside the log. An entry
without a digest was never acknowledged, and may be set aside if a power cut left it torn. An entry
with one that has other bytes now, or is gone, is damaged. Nothing is written here by reading.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path

from ssil_data.errors import DamagedError, NotFoundError
from ssil_data.store.folder import Folder

RECORD = "_acknowledged"
"""Beside the files: lines as of `sha256sum`, and a last one with their own digest."""

LOG = "_delta_log"
"""The folder of the entries, one file for each commit."""

_KEPT = re.compile(r"\d{20}(\.json|\.checkpoint.*\.parquet)")
"""What a digest is kept of; a checkpoint sums up the entries before it."""
_LINE = re.compile(r"([0-9a-f]{64})  ([\w./-]+)")

_Identity = tuple[int, int, int, int]
_verified: dict[Path, dict[str, tuple[_Identity, str]]] = {}
"""Of each folder: the digests that this process took, and of which state of a file."""


def read_record(table: Path) -> dict[str, str] | None:
    """Read the digests of the acknowledged files of a table's log, by name.

    Parameters
    ----------
    table
        The table's folder.

    Returns
    -------
    dict or None
        None for a table that no version with such a record has written to.

    Raises
    ------
    DamagedError
        If the record is not as it was written.
    """
    digests = read_digests(Folder(table))
    prefix = f"{LOG}/"
    if digests is None:
        return None
    names = {name.removeprefix(prefix): digest for name, digest in digests.items()}
    if not all(_KEPT.fullmatch(name) for name in names):
        raise DamagedError(f"{table / RECORD}: it names what is no file of a log")
    return names


def write_record(table: Path, *, keep: Mapping[str, str] | None = None) -> None:
    """Write durably that all of a table's log is acknowledged; the log must be on the disk.

    Called by one writer at a time, see `delta_log.lock_log`.

    Parameters
    ----------
    table
        The table's folder.
    keep
        Digests that stay as they are, whatever the files have become.
    """
    names = sorted(path.name for path in (table / LOG).iterdir() if _KEPT.fullmatch(path.name))
    digests = {name: digest_of(table / LOG / name) for name in names} | dict(keep or {})
    write_digests(Folder(table), {f"{LOG}/{name}": digest for name, digest in digests.items()})


def read_digests(folder: Folder) -> dict[str, str] | None:
    """Read the digests that a folder keeps of its files, by name.

    Parameters
    ----------
    folder
        On disk or in an object store.

    Returns
    -------
    dict or None
        None if it keeps none.

    Raises
    ------
    DamagedError
        If they are not as they were written.
    """
    try:
        data = folder.read(RECORD)
    except NotFoundError:
        return None
    lines = data.decode(errors="replace").split("\n")
    found = [_LINE.fullmatch(line) for line in lines[:-2]]
    is_whole = lines[-1] == "" and lines[-2:-1] == [_own_digest(lines[:-2])]
    if not is_whole or None in found:
        raise DamagedError(f"{folder.uri}/{RECORD}: the kept digests are not as they were written")
    return {match[2]: match[1] for match in found if match}


def write_digests(folder: Folder, digests: Mapping[str, str]) -> None:
    """Keep digests of a folder's files, whole and durably.

    Parameters
    ----------
    folder
        On disk or in an object store.
    digests
        SHA-256 in hexadecimal digits, by name.
    """
    lines = [f"{digests[name]}  {name}" for name in sorted(digests)]
    folder.write(RECORD, "\n".join([*lines, _own_digest(lines), ""]).encode())


def find_log_damage(
    table: Path, record: Mapping[str, str], *, version: int | None = None
) -> list[str]:
    """Name the acknowledged files of a log that are not as they were acknowledged.

    Parameters
    ----------
    table
        The table's folder.
    record
        From `read_record`.
    version
        The last that is to be read; None for all.
    """
    found = []
    for name, expected in sorted(record.items()):
        number = int(name[:20])
        if version is not None and number > version:
            continue
        path = table / LOG / name
        damage = ""
        try:
            if digest_of(path) != expected:
                damage = "is not as it was acknowledged"
        except FileNotFoundError:
            damage = "was acknowledged and is gone"
        if damage:
            found.append(f"{path}: the log entry of version {number} {damage}")
    return found


def digest_of(path: Path) -> str:
    """Return the digest of a file, which is read again only where it changed.

    Parameters
    ----------
    path
        Of the file.

    Raises
    ------
    FileNotFoundError
        If there is none.
    """
    stat = path.stat()
    identity = (stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns)
    known = _verified.setdefault(path.parent, {})
    if path.name not in known or known[path.name][0] != identity:
        with path.open("rb") as file:
            known[path.name] = (identity, hashlib.file_digest(file, "sha256").hexdigest())
    return known[path.name][1]


def _own_digest(lines: list[str]) -> str:
    return "# " + hashlib.sha256("\n".join(lines).encode()).hexdigest()
