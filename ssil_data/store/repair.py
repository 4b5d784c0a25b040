"""What can be restored of a damaged dataset: small files with one flipped bit, and the records.

The digest of a log entry, the card or a run's settings is known, so that the one bit whose flip
gives it back is found by trying all. Parquet files and models are too large for that.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

from ssil_data.errors import DamagedError
from ssil_data.store.acknowledged import (
    LOG,
    RECORD,
    digest_of,
    read_digests,
    read_record,
    write_digests,
    write_record,
)
from ssil_data.store.card import CARD
from ssil_data.store.delta_log import lock_log, set_torn_aside, sync_log
from ssil_data.store.folder import Folder

TABLES = ("pairs", "episodes", "leverage")
LARGEST = 64 * 2**10
"""Bytes of a file whose bits are all tried: some minutes of one processor."""


def repair(dataset: Path) -> list[str]:
    """Restore what can be of a dataset on disk, and say what was done; nobody may write meanwhile.

    Parameters
    ----------
    dataset
        The dataset's folder.

    Returns
    -------
    list of str
        One sentence for each file.

    Raises
    ------
    OSError
        If the disk refuses.
    """
    done = _repair_card(dataset)
    for name in TABLES:
        done += _repair_log(dataset / name)
    for settings in sorted((dataset / "models").glob("*/settings-*.json")):
        identity = settings.stem.removeprefix("settings-")
        done += _restore(settings, lambda digest, wanted=identity: digest.startswith(wanted))
    return done


def _repair_card(dataset: Path) -> list[str]:
    card = dataset / CARD
    try:
        digests = read_digests(Folder(dataset))
    except DamagedError:
        write_digests(Folder(dataset), {CARD: hashlib.sha256(card.read_bytes()).hexdigest()})
        return [f"{dataset / RECORD}: written again from the card as it is"]
    wanted = (digests or {}).get(CARD)
    return _restore(card, lambda digest: digest == wanted) if wanted else []


def _repair_log(table: Path) -> list[str]:
    try:
        record = read_record(table)
    except DamagedError:
        with lock_log(table):
            sync_log(table)
            write_record(table)
        return [f"{table / RECORD}: written again from the log as it is"]
    if record is None:
        aside = set_torn_aside(table, unproven=True)
        return [] if aside is None else [f"{aside}: the newest log entry, set aside"]
    done = []
    for name, wanted in record.items():
        path = table / LOG / name
        if path.exists() and digest_of(path) != wanted:
            done += _restore(path, lambda digest, wanted=wanted: digest == wanted)
    return done


def _restore(path: Path, is_right: Callable[[str], bool]) -> list[str]:
    """Give a file back the one bit that was flipped, if it was one; say so."""
    data = bytearray(path.read_bytes())
    if is_right(hashlib.sha256(data).hexdigest()) or len(data) > LARGEST:
        return []
    for place in range(len(data)):
        for bit in range(8):
            data[place] ^= 1 << bit
            if is_right(hashlib.sha256(data).hexdigest()):
                Folder(path.parent).write(path.name, bytes(data))
                return [f"{path}: restored, bit {bit} of byte {place} had been flipped"]
            data[place] ^= 1 << bit
    return []
