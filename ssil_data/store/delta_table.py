"""Delta Lake tables of plain Parquet whose files are named by the digest of their bytes.

A commit is acknowledged when its files, its log entry and their folders are on the disk. An entry
that a power cut left empty or cut off was never acknowledged, and is set aside on opening.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
from deltalake import CommitProperties, DeltaTable, Schema, Transaction
from deltalake.exceptions import CommitFailedError, DeltaError, TableNotFoundError
from deltalake.transaction import AddAction, RemoveAction

from ssil_data.errors import ConflictError, DamagedError, NotFoundError
from ssil_data.store.folder import Folder, sync

FILE_BYTES = 64 * 2**20
"""A Parquet file is closed when it holds this much Arrow data: the memory that a writer needs."""

_ADDED = "ssilDataAdded"
"""Key of the commit's first line that says how many files it adds."""

BATCH_ROWS = 16_384
"""Rows that a reader of a whole table holds at once."""


@dataclass(frozen=True)
class DataFile:
    """One Parquet file of a table: its path, rows, partition and the episodes it values."""

    path: str
    rows: int
    partition: Mapping[str, str]
    first: int
    last: int
    first_step: int

    @property
    def digest(self) -> str:
        """The digest of the file's bytes, which is its name."""
        return Path(self.path).stem.removeprefix("part-")


class VersionedTable:
    """A table whose rows are ordered by episode and step; a snapshot, taken when it was opened."""

    def __init__(self, folder: Folder, version: int | None = None) -> None:
        """Open the newest version, or the given one; raises NotFoundError."""
        self.folder = folder
        _move_torn_entry(folder)
        try:
            self.delta = DeltaTable(folder.delta_uri, version=version)
        except TableNotFoundError:
            raise NotFoundError(f"table: expected one at {folder.uri}, found none") from None
        except DeltaError as error:
            raise DamagedError(f"{folder.uri}: expected a whole log, found {error}") from None
        self.schema = pa.schema(self.delta.schema().to_arrow())

    @classmethod
    def create(
        cls, folder: Folder, schema: pa.Schema, partition: Sequence[str] = ()
    ) -> VersionedTable:
        """Create an empty table, whose log does not tell where on the machine it was created."""
        folder.make()
        DeltaTable.create(folder.delta_uri, Schema.from_arrow(schema), partition_by=list(partition))
        _forget_location(folder / "_delta_log")
        table = cls(folder)
        table._sync_log()
        return table

    @property
    def version(self) -> int:
        """The number of the newest commit in this snapshot."""
        return self.delta.version()

    @property
    def partition_columns(self) -> list[str]:
        """The columns that are folders and not in the files."""
        return self.delta.metadata().partition_columns

    def files(self) -> list[DataFile]:
        """List the files of the snapshot in the order of their rows."""
        files = []
        for row in pa.table(self.delta.get_add_actions(flatten=False)).to_pylist():
            least, most = row["min"], row["max"]
            files.append(
                DataFile(
                    path=row["path"],
                    rows=row["num_records"],
                    partition=row.get("partition") or {},
                    first=least["episode"],
                    last=most["episode"],
                    first_step=least.get("step", 0),
                )
            )
        return sorted(files, key=lambda file: (file.first, file.last, file.first_step))

    def find_claim(self, claim: str) -> int | None:
        """Return the number under which a commit claimed a name, or None."""
        return self.delta.transaction_version(claim)

    def append(
        self,
        chunks: Iterable[pa.Table],
        *,
        partition: Mapping[str, str] | None = None,
        claim: tuple[str, int],
    ) -> None:
        """Write chunks of rows as one commit that claims a name.

        Raises ConflictError if another writer claimed the same name since this snapshot.
        """
        partition = dict(partition or {})
        actions: list[AddAction | RemoveAction] = [
            self._write(chunk, partition) for chunk in _combine_chunks(chunks)
        ]
        try:
            self.delta.create_write_transaction(
                actions,
                mode="append",
                schema=self.delta.schema(),
                partition_by=self.partition_columns,
                commit_properties=CommitProperties(
                    custom_metadata={_ADDED: len(actions)},
                    app_transactions=[Transaction(*claim)],
                ),
            )
        except CommitFailedError as error:
            raise ConflictError(
                f"{claim[0]}: expected to be alone, found another writer of the same name ({error})"
            ) from None
        self.delta.update_incremental()
        self._sync_log()

    def batches(
        self, files: Iterable[DataFile], columns: Sequence[str], *, rows: int = BATCH_ROWS
    ) -> Iterator[pa.RecordBatch]:
        """Read columns of files in batches of up to `rows` rows; page checksums are verified.

        Raises DamagedError where the bytes are not those that were written.
        """
        for file in files:
            try:
                with self.folder.open(file.path) as source:
                    parquet = pq.ParquetFile(source, page_checksum_verification=True)
                    yield from parquet.iter_batches(batch_size=rows, columns=list(columns))
            except (OSError, pa.ArrowException) as error:
                raise DamagedError(f"{self.folder.uri}/{file.path}: {error}") from None
            except NotFoundError as error:
                raise DamagedError(str(error)) from None

    def find_damage(self) -> list[str]:
        """Read every file and name those that are not what their name and the log say."""
        return [f"{self.folder.uri}/{f.path}: {d}" for f in self.files() if (d := self._damage(f))]

    def _damage(self, file: DataFile) -> str:
        try:
            data = self.folder.read(file.path)
        except NotFoundError:
            return "expected a file, found no file"
        if _digest(data) != file.digest:
            return f"expected {file.digest}, found {_digest(data)}"
        rows = pq.read_metadata(pa.BufferReader(data)).num_rows
        return "" if rows == file.rows else f"expected {file.rows} rows as logged, found {rows}"

    def _write(self, rows: pa.Table, partition: Mapping[str, str]) -> AddAction:
        wanted = [field for field in self.schema if field.name not in partition]
        rows = rows.select([field.name for field in wanted]).cast(pa.schema(wanted))
        sink = pa.BufferOutputStream()
        pq.write_table(
            rows, sink, compression="zstd", use_dictionary=False, write_page_checksum=True
        )
        data = sink.getvalue()
        name = f"part-{_digest(data)}.parquet"
        folder, prefix = self.folder, ""
        for key, value in partition.items():
            folder, prefix = folder / f"{key}={value}", f"{prefix}{key}={value}/"
        folder.write(name, data)
        size, now = len(memoryview(data)), int(time.time() * 1000)
        return AddAction(f"{prefix}{name}", size, dict(partition), now, True, _statistics(rows))

    def _sync_log(self) -> None:
        """Sync the whole log: an entry stands on those before it, whoever wrote them."""
        if self.folder.local is None:
            return
        log = self.folder.local / "_delta_log"
        for entry in log.iterdir():
            with suppress(FileNotFoundError):
                sync(entry)
        sync(log)
        sync(self.folder.local)


def _digest(data: bytes | pa.Buffer) -> str:
    return hashlib.sha256(data).hexdigest()[:32]


def _statistics(rows: pa.Table) -> str:
    """Give Delta's file statistics for the ordering columns, as readers use them to skip files."""
    order = [name for name in ("episode", "step") if name in rows.column_names]
    values = {name: rows[name].to_numpy() for name in order}
    return json.dumps(
        {
            "numRecords": len(rows),
            "minValues": {name: int(value.min()) for name, value in values.items()},
            "maxValues": {name: int(value.max()) for name, value in values.items()},
            "nullCount": dict.fromkeys(order, 0),
        }
    )


def _combine_chunks(chunks: Iterable[pa.Table]) -> Iterator[pa.Table]:
    """Join small chunks into tables of about FILE_BYTES."""
    gathered: list[pa.Table] = []
    size = 0
    for chunk in chunks:
        if gathered and size + chunk.nbytes > FILE_BYTES:
            yield pa.concat_tables(gathered)
            gathered, size = [], 0
        gathered.append(chunk)
        size += chunk.nbytes
    if gathered:
        yield pa.concat_tables(gathered)


def _forget_location(log: Folder) -> None:
    """Take out of a new log's first entry where on the machine the table was created."""
    name = f"{0:020d}.json"
    entries = [json.loads(line) for line in log.read(name).splitlines()]
    entries[0]["commitInfo"]["operationParameters"].pop("location", None)
    log.write(name, "\n".join(map(json.dumps, entries)).encode())


def _move_torn_entry(folder: Folder) -> None:
    """Rename the newest log entry if it is empty or cut off: it was never acknowledged.

    Judged and renamed under a lock, so that nobody renames the whole entry that took its place.
    """
    if folder.local is None or _newest_torn(folder.local) is None:
        return
    import fcntl  # a power cut on a system without it is left to be reported as damage

    lock = os.open(folder.local / "_delta_log", os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        torn = _newest_torn(folder.local)
        if torn is not None:
            torn.rename(torn.with_suffix(".torn"))
            os.fsync(lock)
    except OSError as error:
        raise DamagedError(
            f"{folder.uri}: expected a whole newest log entry, found one cut off that cannot be "
            f"set aside ({error})"
        ) from None
    finally:
        os.close(lock)


def _newest_torn(folder: Path) -> Path | None:
    entries = sorted((folder / "_delta_log").glob("[0-9]*.json"))
    return entries[-1] if entries and not _whole(entries[-1]) else None


def _whole(entry: Path) -> bool:
    """Tell whether all lines of a log entry are JSON and as many as its writer promised."""
    try:
        actions = [json.loads(line) for line in entry.read_text().splitlines()]
        added = actions[0].get("commitInfo", {}).get(_ADDED) if actions else None
    except (ValueError, AttributeError):
        return False
    except FileNotFoundError:
        return True
    kinds = [kind for action in actions for kind in action]
    return bool(actions) and (
        added is None or (kinds.count("add"), kinds.count("txn")) == (added, 1)
    )
