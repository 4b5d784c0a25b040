"""One dataset of the store: its pairs and episodes, its versions, its runs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ssil_data.demonstrations import Episode, Pairs, join_pairs
from ssil_data.errors import InvalidInputError, NotFoundError
from ssil_data.features import Standardizer
from ssil_data.field import LeverageField
from ssil_data.store.arrow_schema import (
    EPISODES,
    description_of,
    dimension_names,
    matrix,
    pairs_of,
    rows_of,
)
from ssil_data.store.delta_table import BATCH_ROWS, DataFile, VersionedTable
from ssil_data.store.folder import Folder
from ssil_data.store.runs import Runs

CARD = "card.md"


class Dataset:
    """One version of a dataset: what was in it when it was opened.

    An episode exists when the episodes table has its row. Pairs are written first, so an import
    that was killed between the two leaves rows that no version reads.
    """

    def __init__(self, folder: Folder, version: int | None = None) -> None:
        """Open the newest version, or the one that a commit of the episodes table made."""
        self.folder = folder
        self.name = folder.uri.rsplit("/", 1)[-1]
        self._episodes = VersionedTable(folder / "episodes", version)
        self._pairs = VersionedTable(folder / "pairs")

    def __repr__(self) -> str:
        """Show name and version."""
        return f"Dataset({self.name!r}, version={self.version!r})"

    def __len__(self) -> int:
        """Count the pairs."""
        return sum(file.rows for file in self._files)

    @cached_property
    def episodes(self) -> pa.Table:
        """The episodes in order: episode, length, labeled, source, score, tier, ending."""
        batches = self._episodes.batches(self._episodes.files(), EPISODES.names)
        return pa.Table.from_batches(batches, EPISODES)

    @cached_property
    def _files(self) -> list[DataFile]:
        known = set(self.episodes["episode"].to_pylist())
        return [file for file in self._pairs.files() if file.first in known]

    @property
    def state_names(self) -> list[str]:
        """The names of the d state dimensions."""
        return dimension_names(self._pairs.schema, "state")

    @property
    def action_names(self) -> list[str]:
        """The names of the k action dimensions."""
        return dimension_names(self._pairs.schema, "action")

    @property
    def card(self) -> str:
        """The dataset's card, Markdown."""
        return self.folder.read(CARD).decode()

    @cached_property
    def version(self) -> str:
        """The fingerprint of the dataset: a digest over the digests of its files."""
        files = [file.path for file in (*self._files, *self._episodes.files())]
        names = json.dumps([self.state_names, self.action_names])
        return hashlib.sha256("\n".join([names, *files]).encode()).hexdigest()[:16]

    def checksums(self) -> str:
        """Return the version and the files with their digests, as a section of a card."""
        files = {"pairs": self._files, "episodes": self._episodes.files()}
        rows = [
            f"| {table} | {file.rows:,} | `{file.digest}` |"
            for table, listed in files.items()
            for file in listed
        ]
        head = (
            f"## Files\n\nVersion `{self.version}`. The digest, half a SHA-256, is a file's name; "
            "`ssil-data validate` compares them.\n\n| table | rows | digest |\n|---|---|---|\n"
        )
        return head + "\n".join(rows) + "\n"

    @property
    def versions(self) -> list[str]:
        """The fingerprints of all versions up to this one, which is the last."""
        return [
            Dataset(self.folder, number).version for number in range(1, self._episodes.version + 1)
        ]

    def at(self, version: str) -> Dataset:
        """Open an earlier version by its fingerprint; raises NotFoundError."""
        versions = self.versions
        if version not in versions:
            raise NotFoundError(
                f"version of {self.name}: expected one of {versions}, found {version!r}"
            )
        return Dataset(self.folder, versions.index(version) + 1)

    def append(self, episodes: Iterable[Episode]) -> Dataset:
        """Add episodes, numbered on from the last, and return the new version.

        Raises InvalidInputError for other widths or no episode, ConflictError if another writer
        added episodes meanwhile; the dataset is then unchanged.
        """
        pairs, table = VersionedTable(self._pairs.folder), VersionedTable(self._episodes.folder)
        first = max((file.last for file in pairs.files()), default=-1) + 1
        rows: list[dict[str, Any]] = []

        def chunks() -> Iterator[pa.Table]:
            for number, episode in enumerate(episodes, start=first):
                yield rows_of(number, episode, pairs.schema)
                rows.append(description_of(number, episode))
            if not rows:
                raise InvalidInputError("episodes: expected at least one, found none")

        pairs.append(chunks(), claim=("append", first))
        table.append([pa.Table.from_pylist(rows, EPISODES)], claim=("append", first))
        return Dataset(self.folder)

    def batches(self, *, rows: int = BATCH_ROWS) -> Iterator[Pairs]:
        """Read all pairs in order, up to `rows` at a time; episodes may be cut between batches."""
        return self._read(self._files, rows)

    def _read(self, files: Iterable[DataFile], rows: int = BATCH_ROWS) -> Iterator[Pairs]:
        columns = ("episode", "step", "state", "action")
        for batch in self._pairs.batches(files, columns, rows=rows):
            yield pairs_of(batch, self._pairs.schema)

    def index(self) -> Iterator[pa.RecordBatch]:
        """Read which episode and step each pair is, in order and in batches."""
        return self._pairs.batches(self._files, ("episode", "step"))

    def pairs(self) -> Pairs:
        """Read all pairs into memory."""
        return join_pairs(list(self.batches()))

    def episode(self, number: int) -> Pairs:
        """Read the pairs of one episode; raises NotFoundError."""
        if number not in self.episodes["episode"].to_pylist():
            raise NotFoundError(
                f"episode of {self.name}: expected 0 to {len(self.episodes) - 1}, found {number}"
            )
        return self._read_episodes(np.array([number]))

    def labeled(self) -> Pairs:
        """Read the labeled pairs; raises InvalidInputError if there are none."""
        chosen = self.episodes.filter(pc.field("labeled"))["episode"].to_numpy()
        if not len(chosen):
            raise InvalidInputError(
                f"labeled episodes of {self.name}: expected at least one, found none among "
                f"{len(self.episodes)}"
            )
        return self._read_episodes(chosen)

    def _read_episodes(self, episodes: NDArray[np.int64]) -> Pairs:
        files = [
            file
            for file in self._files
            if np.any((episodes >= file.first) & (episodes <= file.last))
        ]
        return join_pairs(
            [batch.where(np.isin(batch.episode, episodes)) for batch in self._read(files)]
        )

    def per_pair(self, column: str) -> NDArray[Any]:
        """Return a column of the episodes table, such as `labeled`, for every pair (n,)."""
        values = self.episodes[column].to_numpy()
        return np.repeat(values, self.episodes["length"].to_numpy())

    def read_recorded(self, column: str) -> NDArray[np.float32] | None:
        """Read `reward` (n,) or `position` (n, 2) of every pair; None where any has none.

        For evaluation and maps only: no estimator or trainer reads them.
        """
        batches = list(self._pairs.batches(self._files, [column]))
        values = pa.Table.from_batches(batches)[column].combine_chunks()
        if values.null_count:
            return None
        return matrix(values, 2) if column == "position" else values.to_numpy()

    @property
    def runs(self) -> Runs:
        """The scoring runs, by name."""
        return Runs(self.folder, self.version)

    def leverage(self, run: str) -> NDArray[np.float32]:
        """Read the leverage that a run gave to every pair, (n,) in [0, 1]."""
        return self.runs.values(run)["leverage"].to_numpy()

    def field(
        self,
        run: str,
        *,
        alpha: float | None = None,
        device: str = "cpu",
        threads: int | None = None,
    ) -> LeverageField:
        """Return the leverage field of a run over all states, with the run's alpha or another.

        `device` is where torch holds the states, as "cuda"; on "cpu" code is written for the host,
        whose processors are all used, or `threads` of them.
        """
        record = self.runs[run]
        return LeverageField(
            states=self.pairs().states,
            leverage=self.leverage(run),
            labeled=self.per_pair("labeled").astype(bool),
            standardizer=Standardizer(
                np.asarray(record.shift, np.float32), np.asarray(record.spread, np.float32)
            ),
            alpha=record.alpha if alpha is None else alpha,
            device=device,
            threads=threads,
        )

    def find_damage(self) -> list[str]:
        """Read every file of the dataset and say which are not as they were written."""
        return [*self._pairs.find_damage(), *self._episodes.find_damage(), *self.runs.find_damage()]
