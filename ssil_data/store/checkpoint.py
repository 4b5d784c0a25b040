"""A sum of a log's entries now and then, so that opening does not read them all; none is removed.

Delta Lake writes its own in place, where a power cut leaves it torn, and removes older entries.
This one is made beside the table, from links to the log, and renamed.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from deltalake import DeltaTable

from ssil_data.store.acknowledged import LOG
from ssil_data.store.folder import Folder, sync

EVERY = 100
"""Commits between two checkpoints."""
HINT = "_last_checkpoint"
"""Delta Lake's own file that names the newest one."""
_PREFIX = ".checkpoint-"


def write_checkpoint(table: Path, version: int) -> None:
    """Write the checkpoint of a version durably: it is there whole or not at all.

    Parameters
    ----------
    table
        The table's folder; one writer at a time, see `delta_log.lock_log`.
    version
        Of the newest commit that it sums up.

    Raises
    ------
    OSError
        If the disk refuses.
    """
    for left in table.glob(f"{_PREFIX}*"):  # by a process that was killed
        shutil.rmtree(left, ignore_errors=True)
    with tempfile.TemporaryDirectory(dir=table, prefix=_PREFIX) as folder:
        log = Path(folder) / LOG
        log.mkdir()
        for file in (table / LOG).iterdir():
            if file.suffix in (".json", ".parquet"):
                os.link(file, log / file.name)
        DeltaTable(Path(folder).as_uri(), version=version).create_checkpoint()
        for made in log.glob(f"{version:020d}.checkpoint*.parquet"):
            sync(made)
            made.replace(table / LOG / made.name)
        sync(table / LOG)
        Folder(table / LOG).write(HINT, (log / HINT).read_bytes())
