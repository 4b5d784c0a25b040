"""Delta Lake tables of plain Parquet whose files are named by the digest of their bytes."""

from __future__ import annotations

import hashlib
import json
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
from ssil_data.store.delta_log import ADDED, LOG, forget_location, move_torn_entry, sync_log
from ssil_data.store.folder import Folder

FILE_BYTES = 64 * 2**20
"""A Parquet file is closed when it holds this much Arrow data: the memory that a writer needs."""

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
        move_torn_entry(folder)
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
        DeltaTable.create(folder.delta_uri, Schema.from_arrow(schema), partition_by=list(partition))
        forget_location(folder / LOG)
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
            least = row["min"]
            most = row["max"]
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
            )
        except CommitFailedError as error:
            raise ConflictError(
                f"{claim[0]}: another writer took the name first; open it anew ({error})"
            ) from None
        self.delta.update_incremental()
        self._sync_log()

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
        with suppress(CommitFailedError):  # another writer added them first
            self.delta.alter.add_columns(list(fields))
        self.delta.update_incremental()
        self.schema = pa.schema(self.delta.schema().to_arrow())
        self._sync_log()

    def batches(
        self, files: Iterable[DataFile], columns: Sequence[str], *, rows: int = BATCH_ROWS
    ) -> Iterator[pa.RecordBatch]:
        """Read columns of files in batches; page checksums are verified.

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
                with self.folder.open(file.path) as source:
                    parquet = pq.ParquetFile(source, page_checksum_verification=True)
                    yield from parquet.iter_batches(batch_size=rows, columns=list(columns))
            except (OSError, pa.ArrowException) as error:
                raise DamagedError(f"{self.folder.uri}/{file.path}: {error}") from None
            except NotFoundError as error:
                raise DamagedError(str(error)) from None

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

    def _sync_log(self) -> None:
        """Put the log on the disk; an object store has done so already."""
        if self.folder.local is not None:
            sync_log(self.folder.local)


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
            gathered = []
            size = 0
        gathered.append(chunk)
        size += chunk.nbytes
    if gathered:
        yield pa.concat_tables(gathered)
