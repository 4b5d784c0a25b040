"""Delta Lake tables of plain Parquet whose files are named by the digest of their bytes."""

from __future__ import annotations

import hashlib
import json
import operator
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from deltalake import (
    CommitProperties,
    DeltaTable,
    PostCommitHookProperties,
    Schema,
    Transaction,
)
from deltalake.exceptions import CommitFailedError, DeltaError, TableNotFoundError
from deltalake.transaction import AddAction, RemoveAction

from ssil_data.errors import ConflictError, DamagedError, NotFoundError
from ssil_data.store.acknowledged import LOG, digest_of
from ssil_data.store.delta_log import (
    ADDED,
    acknowledge,
    find_readable,
    forget_location,
    set_torn_aside,
)
from ssil_data.store.folder import Folder

FILE_BYTES = 64 * 2**20
"""A Parquet file is closed when it holds this much Arrow data: the memory that a writer needs."""

KEEP_LOG = PostCommitHookProperties(create_checkpoint=False, cleanup_expired_logs=False)
"""Of every commit: the log is the history, which nothing may shorten; see `checkpoint`."""

DIGITS = 32
"""Of SHA-256 in the name of a file."""

BATCH_ROWS = 16_384
"""Rows that a reader of a whole table has in memory at once."""


@dataclass(frozen=True)
class DataFile:
    """One Parquet file of a table, as the log describes it.

    Parameters
    ----------
    path
        Below the table's folder.
    rows
        How many it has.
    partition
        Values of the partition columns, such as the run's name.
    first, last
        The first and the last episode with rows in it.
    first_step
        The least step in it.
    """

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
        """Open the newest version, or the given one.

        Parameters
        ----------
        folder
            The table's folder.
        version
            Number of a commit, None for the newest.

        Raises
        ------
        NotFoundError
            If there is no table.
        DamagedError
            If the log cannot be read.
        """
        self.folder = folder
        if folder.local is not None:
            folder.check_files(LOG)
            version = find_readable(folder.local, version)
        try:
            self.delta = DeltaTable(folder.delta_uri, version=version)
        except TableNotFoundError:
            raise NotFoundError(f"table: there is none at {folder.uri}") from None
        except DeltaError as error:
            raise DamagedError(f"{folder.uri}: its log is damaged: {error}") from None
        self.schema = pa.schema(self.delta.schema().to_arrow())

    @classmethod
    def create(
        cls, folder: Folder, schema: pa.Schema, partition: Sequence[str] = ()
    ) -> VersionedTable:
        """Create an empty table, whose log does not say where on the machine it was created.

        Parameters
        ----------
        folder
            The table's folder; it must hold no table.
        schema
            The columns.
        partition
            Names of columns that become folders.
        """
        folder.make()
        DeltaTable.create(
            folder.delta_uri,
            Schema.from_arrow(schema),
            partition_by=list(partition),
            configuration={"delta.enableExpiredLogCleanup": "false"},  # for writers of others
            post_commithook_properties=KEEP_LOG,
        )
        forget_location(folder / LOG)
        table = cls(folder)
        table._acknowledge()
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
        rows = pa.table(self.delta.get_add_actions(flatten=False)).to_pylist()
        try:
            files = [_describe_file(row) for row in rows]
        except (KeyError, TypeError, ValueError) as error:
            raise DamagedError(
                f"{self.folder.uri}: its log describes a file that is none of it ({error!r})"
            ) from None
        return sorted(files, key=_order)

    def history(self) -> Iterator[tuple[int, list[DataFile]]]:
        """Go through the versions that can be opened, up to this one, and the files of each.

        The log is read once, however many there are. What another writer cut off its beginning is
        passed over, as a checkpoint has the files of the first version that is left.

        Raises
        ------
        DamagedError
            If the log cannot be read.
        """
        entries = set((self.folder / LOG).names())
        first = self.version
        while first > 0 and _entry(first - 1) in entries:
            first -= 1
        files = VersionedTable(self.folder, first).files() if first else []
        yield first, files
        for number in range(first + 1, self.version + 1):
            try:
                lines = (self.folder / LOG).read(_entry(number)).splitlines()
                actions = [json.loads(line) for line in lines]
                added = [_read_add(action["add"]) for action in actions if "add" in action]
            except (NotFoundError, ValueError, KeyError, TypeError) as error:
                raise DamagedError(
                    f"{self.folder.uri}/{LOG}/{_entry(number)}: damaged ({error})"
                ) from None
            files = [*files, *added]
            yield number, sorted(files, key=_order)

    def find_claim(self, claim: str) -> int | None:
        """Return the number under which a commit claimed a name, or None.

        Parameters
        ----------
        claim
            The name.
        """
        return self.delta.transaction_version(claim)

    def append(
        self,
        chunks: Iterable[pa.Table],
        *,
        partition: Mapping[str, str] | None = None,
        claim: tuple[str, int],
    ) -> None:
        """Write chunks of rows as one commit that claims a name.

        Parameters
        ----------
        chunks
            Rows in order; small chunks are joined into files of `FILE_BYTES`.
        partition
            Values of the partition columns.
        claim
            A name that no other commit may claim at the same time, and a number beside it.

        Raises
        ------
        ConflictError
            If another writer claimed the same name since this snapshot.
        """
        partition = dict(partition or {})
        actions: list[AddAction | RemoveAction] = [
            self._write(chunk, partition) for chunk in _combine_chunks(chunks)
        ]
        self._set_torn_aside()
        try:
            self.delta.create_write_transaction(
                actions,
                mode="append",
                schema=self.delta.schema(),
                partition_by=self.partition_columns,
                commit_properties=CommitProperties(
                    custom_metadata={ADDED: len(actions)},
                    app_transactions=[Transaction(*claim)],
                ),
                post_commithook_properties=KEEP_LOG,
            )
        except CommitFailedError as error:
            raise ConflictError(
                f"{claim[0]}: another writer took the name first; open it anew ({error})"
            ) from None
        self.delta.update_incremental()
        self._acknowledge()

    def add_columns(self, schema: pa.Schema) -> None:
        """Add columns that the table lacks, in a commit of its own; old rows have null there.

        Parameters
        ----------
        schema
            The columns that are to be there.
        """
        missing = [field for field in schema if field.name not in self.schema.names]
        if not missing:
            return
        fields = Schema.from_arrow(pa.schema(missing)).fields
        self._set_torn_aside()
        with suppress(CommitFailedError):  # another writer added them first
            self.delta.alter.add_columns(list(fields), post_commithook_properties=KEEP_LOG)
        self.delta.update_incremental()
        self.schema = pa.schema(self.delta.schema().to_arrow())
        self._acknowledge()

    def batches(
        self, files: Iterable[DataFile], columns: Sequence[str], *, rows: int = BATCH_ROWS
    ) -> Iterator[pa.RecordBatch]:
        """Read columns of files in batches; their bytes are verified.

        On disk, a process takes the digest of each file once; in an object store, which is read in
        parts, the checksums of its pages are compared.

        Parameters
        ----------
        files
            Files of this table, read in the order given.
        columns
            Names of columns.
        rows
            Rows of a batch at most.

        Raises
        ------
        DamagedError
            Where the bytes are not those that were written.
        """
        for file in files:
            try:
                self._check_digest(file)
                with self.folder.open(file.path) as source:
                    parquet = pq.ParquetFile(source, page_checksum_verification=True)
                    self._check_columns(parquet.schema_arrow, columns)
                    yield from parquet.iter_batches(batch_size=rows, columns=list(columns))
            except (OSError, pa.ArrowException) as error:
                raise DamagedError(f"{self.folder.uri}/{file.path}: {error}") from None
            except NotFoundError as error:
                raise DamagedError(str(error)) from None

    def _check_digest(self, file: DataFile) -> None:
        """Raise DamagedError if a file on disk has other bytes than its name says."""
        local = self.folder.local
        if local is None or not self.folder.exists(file.path):
            return
        self.folder.check_file(file.path)
        found = digest_of(local / file.path)[:DIGITS]
        if found != file.digest:
            raise DamagedError(
                f"{self.folder.uri}/{file.path}: expected {file.digest}, found {found}"
            )

    def _check_columns(self, schema: pa.Schema, columns: Sequence[str]) -> None:
        """Raise ArrowInvalid unless a file has columns as the table does."""
        for name in columns:
            expected = self.schema.field(name).type if name in self.schema.names else None
            found = schema.field(name).type if name in schema.names else None
            added_later = found is None and bool(self.partition_columns)
            if not added_later and found != expected:
                raise pa.ArrowInvalid(f"column {name}: expected {expected}, found {found}")

    def find_damage(self) -> list[str]:
        """Read every file and name those that are not what their name and the log say."""
        return [
            f"{self.folder.uri}/{file.path}: {damage}"
            for file in self.files()
            if (damage := self._find_damage(file))
        ]

    def _find_damage(self, file: DataFile) -> str:
        """Say what is wrong with a file; nothing is if the answer is empty."""
        try:
            data = self.folder.read(file.path)
        except NotFoundError:
            return "the file is missing"
        if _digest(data) != file.digest:
            return f"expected {file.digest}, found {_digest(data)}"
        rows = pq.read_metadata(pa.BufferReader(data)).num_rows
        return "" if rows == file.rows else f"expected {file.rows} rows as logged, found {rows}"

    def _write(self, rows: pa.Table, partition: Mapping[str, str]) -> AddAction:
        """Write rows as a file named by its digest, in the folder of its partition."""
        stored = [field for field in self.schema if field.name not in partition]
        rows = rows.select([field.name for field in stored]).cast(pa.schema(stored))
        sink = pa.BufferOutputStream()
        pq.write_table(
            rows, sink, compression="zstd", use_dictionary=False, write_page_checksum=True
        )
        data = sink.getvalue()
        name = f"part-{_digest(data)}.parquet"
        folder = self.folder
        for key, value in partition.items():
            folder = folder / f"{key}={value}"
        folder.write(name, data)
        path = f"{folder.uri}/{name}".removeprefix(f"{self.folder.uri}/")
        size = len(memoryview(data))
        now = int(time.time() * 1000)
        return AddAction(path, size, dict(partition), now, True, _statistics(rows))

    def _set_torn_aside(self) -> None:
        """Let an entry that a power cut left torn, and nobody acknowledged, not stop a writer."""
        if self.folder.local is not None:
            set_torn_aside(self.folder.local)

    def _acknowledge(self) -> None:
        """Put the log and its digests on the disk; an object store has written it whole already."""
        if self.folder.local is not None:
            acknowledge(self.folder.local, self.version)


def _entry(version: int) -> str:
    return f"{version:020d}.json"


def _order(file: DataFile) -> tuple[int, int, int]:
    return file.first, file.last, file.first_step


def _read_add(add: dict[str, Any]) -> DataFile:
    """Read one file of a log entry."""
    statistics = json.loads(add["stats"])
    return _describe_file(
        {
            "path": add["path"],
            "num_records": statistics["numRecords"],
            "partition": add["partitionValues"],
            "min": statistics["minValues"],
            "max": statistics["maxValues"],
        }
    )


def _describe_file(row: Mapping[str, Any]) -> DataFile:
    """Read one file of a log; raises KeyError, TypeError or ValueError for what is none."""
    path = PurePosixPath(row["path"])
    if path.is_absolute() or ".." in path.parts or ":" in row["path"]:
        raise ValueError(row["path"])
    least = row["min"]
    return DataFile(
        path=row["path"],
        rows=operator.index(row["num_records"]),
        partition=row.get("partition") or {},
        first=operator.index(least["episode"]),
        last=operator.index(row["max"]["episode"]),
        first_step=operator.index(least.get("step", 0)),
    )


def _digest(data: bytes | pa.Buffer) -> str:
    return hashlib.sha256(data).hexdigest()[:DIGITS]


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
            gathered = []
            size = 0
        gathered.append(chunk)
        size += chunk.nbytes
    if gathered:
        yield pa.concat_tables(gathered)
