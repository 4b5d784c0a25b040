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
from ssil_data.errors import DamagedError, InvalidInputError, NotFoundError
from ssil_data.features import Standardizer
from ssil_data.field import LeverageField
from ssil_data.leverage_model import LeverageModel
from ssil_data.store.arrow_schema import (
    EPISODES,
    decode_pairs,
    describe_episode,
    dimension_names,
    encode_episode,
    matrix,
)
from ssil_data.store.card import find_card_damage, read_card
from ssil_data.store.delta_table import BATCH_ROWS, DataFile, VersionedTable
from ssil_data.store.episodes import check_episode, check_labeled, repeat_per_pair
from ssil_data.store.folder import Folder
from ssil_data.store.runs import Runs


class Dataset:
    """One version of a dataset: what was in it when it was opened.

    An episode exists when the episodes table has its row. Pairs are written first, so an import
    that was killed between the two leaves rows that no version reads.

    Parameters
    ----------
    folder
        The dataset's folder; `Store[name]` opens it by name.
    version
        Number of a commit of the episodes table, None for the newest; `at` opens a version by its
        fingerprint.

    Raises
    ------
    DamagedError
        If a table's log cannot be read.

    Examples
    --------
    >>> dataset = store["drives"]
    >>> dataset.name, len(dataset), dataset.state_names
    ('drives', 420, ['distance', 'speed', 'heading'])
    >>> field = dataset.field("vae")
    >>> field.lcor(dataset.episode(0).states).values.shape
    (60,)
    """

    def __init__(self, folder: Folder, version: int | None = None) -> None:
        """Open a version; its values are read on first use."""
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

    @property
    def episodes(self) -> pa.Table:
        """The episodes in order: episode, length, labeled, source, score, tier, ending."""
        return self._episodes_table

    @cached_property
    def _episodes_table(self) -> pa.Table:
        batches = self._episodes.batches(self._episodes.files(), EPISODES.names)
        return pa.Table.from_batches(batches, EPISODES)

    @cached_property
    def _files(self) -> list[DataFile]:
        known = set(self.episodes["episode"].to_pylist())
        files = [file for file in self._pairs.files() if file.first in known]
        rows = sum(file.rows for file in files)
        expected = int(self.episodes["length"].to_numpy().sum())
        if rows != expected:
            raise DamagedError(
                f"{self.folder.uri}: the episodes have {expected:,} pairs, and the log of pairs "
                f"has {rows:,}; nothing can be added before it is restored"
            )
        return files

    def _check_counts(self) -> None:
        """Compare what the logs say of pairs and episodes; raises DamagedError."""
        _ = self._files

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
        return read_card(self.folder)

    @property
    def version(self) -> str:
        """The fingerprint of the dataset: a digest over the digests of its files."""
        return self._fingerprint

    @cached_property
    def _fingerprint(self) -> str:
        return self._fingerprint_of(self._files, self._episodes.files())

    def _fingerprint_of(self, pairs: list[DataFile], episodes: list[DataFile]) -> str:
        files = [file.path for file in (*pairs, *episodes)]
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
        return list(self._numbers)

    @cached_property
    def _numbers(self) -> dict[str, int]:
        """Of each version, by fingerprint: the number of its commit of the episodes table."""
        pairs = self._pairs.files()
        within: list[DataFile] = []
        before = 0
        numbers = {}
        for number, episodes in self._episodes.history():
            new = [(file.first, file.last) for file in episodes[before:]]
            before = len(episodes)
            within += [
                file for file in pairs if any(first <= file.first <= last for first, last in new)
            ]
            if episodes:
                numbers[self._fingerprint_of(within, episodes)] = number
        return numbers

    def at(self, version: str) -> Dataset:
        """Open an earlier version.

        Parameters
        ----------
        version
            Its fingerprint, one of `versions`.

        Raises
        ------
        NotFoundError
            If there is no such version.
        """
        if version not in self._numbers:
            raise NotFoundError(
                f"version of {self.name}: expected one of {self.versions}, found {version!r}"
            )
        return Dataset(self.folder, self._numbers[version])

    def append(self, episodes: Iterable[Episode]) -> Dataset:
        """Add episodes, numbered on from the last, as a new version.

        Parameters
        ----------
        episodes
            At least one, of the dataset's widths.

        Returns
        -------
        Dataset
            The new version; this one stays as it is.

        Raises
        ------
        InvalidInputError
            For episodes of another width, or none; nothing is written then.
        ConflictError
            If another writer added episodes meanwhile; nothing is written then.
        """
        newest = Dataset(self.folder)
        pairs = newest._pairs
        table = newest._episodes
        newest._check_counts()
        # an append that was killed may have left pairs without their episodes
        known = (*pairs.files(), *table.files())
        first = max((file.last for file in known), default=-1) + 1
        rows: list[dict[str, Any]] = []

        def chunks() -> Iterator[pa.Table]:
            for number, episode in enumerate(episodes, start=first):
                yield encode_episode(number, episode, pairs.schema)
                rows.append(describe_episode(number, episode))
            if not rows:
                raise InvalidInputError("episodes: expected at least one, found none")

        pairs.append(chunks(), claim=("append", first))
        table.append([pa.Table.from_pylist(rows, EPISODES)], claim=("append", first))
        return Dataset(self.folder)

    def batches(self, *, rows: int = BATCH_ROWS) -> Iterator[Pairs]:
        """Read all pairs in order, in batches; episodes may be cut between them.

        Parameters
        ----------
        rows
            Pairs of a batch at most.

        Raises
        ------
        DamagedError
            Where bytes are not those that were written.
        """
        return self._read(self._files, rows)

    def _read(self, files: Iterable[DataFile], rows: int = BATCH_ROWS) -> Iterator[Pairs]:
        columns = ("episode", "step", "state", "action")
        for batch in self._pairs.batches(files, columns, rows=rows):
            yield decode_pairs(batch, self._pairs.schema)

    def index(self) -> Iterator[pa.RecordBatch]:
        """Read which episode and step each pair is, in order and in batches."""
        return self._pairs.batches(self._files, ("episode", "step"))

    def pairs(self) -> Pairs:
        """Read all pairs into memory."""
        return join_pairs(list(self.batches()))

    def episode(self, number: int) -> Pairs:
        """Read the pairs of one episode.

        Parameters
        ----------
        number
            Of the episode, from 0.

        Raises
        ------
        NotFoundError
            If there is none of that number.
        """
        check_episode(self.name, self.episodes, number)
        return self._read_episodes(np.array([number]))

    def labeled(self) -> Pairs:
        """Read the pairs of the labeled episodes.

        Raises
        ------
        InvalidInputError
            If there are none.
        """
        check_labeled(self.name, self.episodes)
        chosen = self.episodes.filter(pc.field("labeled"))["episode"].to_numpy()
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
        """Return a column of the episodes table for every pair (n,).

        Parameters
        ----------
        column
            Its name, such as `labeled` or `tier`.
        """
        return repeat_per_pair(self.episodes, column)

    def read_recorded(self, column: str) -> NDArray[np.float32] | None:
        """Read what was recorded beside every pair, for evaluation and maps only.

        No estimator or trainer reads it.

        Parameters
        ----------
        column
            `reward` or `position`.

        Returns
        -------
        ndarray or None
            (n,), or (n, 2) in meters; None where any pair has none.
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
        """Read the leverage that a run gave to every pair, (n,) in [0, 1]; 1 = expert-like.

        Parameters
        ----------
        run
            The run's name.

        Raises
        ------
        NotFoundError
            If no run has the name.
        ConflictError
            If the run was made from another version.
        """
        return self.runs.values(run)["leverage"].to_numpy()

    def model(self, run: str) -> LeverageModel:
        """Return the fitted estimator and scale of a run of any version.

        Parameters
        ----------
        run
            The run's name.

        Raises
        ------
        NotFoundError
            If no run has the name.
        DamagedError
            Where bytes are not those that were written.
        """
        record = self.runs.of_any_version(run)
        return LeverageModel.from_archive(
            self.runs.model(record), record.fitted_scale, record.fitted_pooling
        )

    def field(
        self,
        run: str,
        *,
        alpha: float | None = None,
        device: str = "cpu",
        threads: int | None = None,
    ) -> LeverageField:
        """Return the leverage field of a run, which gives LCoR of any state.

        Parameters
        ----------
        run
            The run's name.
        alpha
            Sharpness of the kernel; the run's own unless given.
        device
            "cpu", where machine code is generated for the host, or where torch keeps the states,
            such as "cuda".
        threads
            Processors to use on "cpu"; all unless given.

        Raises
        ------
        NotFoundError
            If no run has the name.
        ConflictError
            If the run was made from another version.
        InvalidInputError
            For an alpha that is not positive.
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
        """Read every file of the dataset and say which are not as they were written.

        Raises
        ------
        DamagedError
            If the logs of pairs and episodes contradict each other, so that there is no dataset.
        """
        found = [
            *self._pairs.find_damage(),
            *self._episodes.find_damage(),
            *self.runs.find_damage(),
            *find_card_damage(self.folder),
        ]
        return found or self._find_contradictions()

    def _find_contradictions(self) -> list[str]:
        """Compare the pairs with the episodes' numbers and lengths."""
        numbers = self.episodes["episode"].to_numpy()
        lengths = self.episodes["length"].to_numpy()
        found = np.zeros(int(numbers.max(initial=-1)) + 1, np.int64)
        for batch in self.index():
            found += np.bincount(batch["episode"].to_numpy(), minlength=len(found))[: len(found)]
        repeated = len(numbers) - len(np.unique(numbers))
        wrong = numbers[found[numbers] != lengths]
        problems = []
        if repeated:
            problems.append(f"{self.folder.uri}: {repeated} episode numbers are there twice")
        if len(wrong):
            problems.append(
                f"{self.folder.uri}: episode {wrong[0]} has {found[wrong[0]]} pairs and not as "
                f"many as its length says ({len(wrong)} such episodes)"
            )
        return problems
