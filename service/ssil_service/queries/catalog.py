"""The store as the service sees it: newest versions without a restart, and a cache of its content.

A request looks at the modification times of a dataset's two log folders, and reads the dataset anew
only if they have changed.
"""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa

from ssil_data.demonstrations import Pairs
from ssil_data.errors import NotFoundError, SsilDataError
from ssil_data.field import LeverageField
from ssil_data.scoring import LeverageModel
from ssil_data.store import Store
from ssil_data.store.card import CARD
from ssil_data.store.dataset import Dataset
from ssil_data.store.folder import check_name
from ssil_service.queries.cache import Cache
from ssil_service.queries.snapshot import Snapshot

_SETTLED_SECONDS = 0.1
"""A modification time this old differs from that of any later change."""
_TRUSTED_SECONDS = 2.0
"""An object store has no such times: a snapshot of it is used for so long."""
_MOST_SNAPSHOTS = 256
_SNAPSHOT_BYTES = 4096

Found = TypeVar("Found")


class Catalog:
    """Snapshots of datasets, as new as the store, and what was read of them lately.

    Parameters
    ----------
    store
        The store.
    cache_bytes
        Bytes that cached fields, models and values may take.

    Attributes
    ----------
    cache
        These, by keys whose second part is the dataset's name.
    """

    def __init__(self, store: Store, cache_bytes: int) -> None:
        self.store = store
        self.cache = Cache(cache_bytes)
        self._newest: dict[str, tuple[Any, Snapshot]] = {}

    async def snapshot(self, name: str, version: str | None = None) -> Snapshot:
        """Return a version of a dataset.

        Parameters
        ----------
        name
            The dataset's.
        version
            Its fingerprint; None for the newest.

        Returns
        -------
        Snapshot
            With the runs of this moment.

        Raises
        ------
        NotFoundError
            If there is no such dataset or version.
        """
        token = self._token(check_name("dataset", name))
        known = self._newest.get(name)
        if known is None or known[0] != token:
            newest = await asyncio.to_thread(self._open, name)
            self._newest[name] = (token, newest)
            while len(self._newest) > _MOST_SNAPSHOTS:
                del self._newest[next(iter(self._newest))]
        else:
            newest = known[1]
        if version is None or version == newest.version:
            return newest
        key = ("version", name, newest.version, token, version)
        return await self._get(
            key, lambda: (Snapshot.of(newest.dataset.at(version)), _SNAPSHOT_BYTES)
        )

    async def read(self, snapshot: Snapshot, work: Callable[[Dataset], Found]) -> Found:
        """Read something of a dataset in a thread, uncached.

        Parameters
        ----------
        snapshot
            The dataset.
        work
            Reads and returns it.

        Returns
        -------
        Found
            What `work` returns.

        Raises
        ------
        NotFoundError
            If the dataset is deleted meanwhile.
        """
        dataset = snapshot.dataset
        return await asyncio.to_thread(self._check_deleted, snapshot.name, lambda: work(dataset))

    async def field(self, snapshot: Snapshot, run: str, alpha: float | None) -> LeverageField:
        """Return the leverage field of a run.

        Parameters
        ----------
        snapshot
            The dataset's version that the run was made from.
        run
            The run's name.
        alpha
            Sharpness of the kernel; None for the run's own. Fields of other sharpness share the
            states of the run's own.

        Returns
        -------
        LeverageField
            Ready to answer.

        Raises
        ------
        NotFoundError, ConflictError
            As `Snapshot.run` does.
        """
        record = snapshot.run(run)
        key = ("field", snapshot.name, snapshot.version, record.created, run)
        own: LeverageField = await self._get(key, lambda: _open_field(snapshot, run))
        if alpha in (None, record.alpha):
            return own
        found = await self._get((*key, alpha), lambda: (own.at(alpha), _sample_bytes(own)))
        self.cache.peek(key)  # counts as used: the one that has the states is to be dropped last
        return found

    async def model(self, snapshot: Snapshot, run: str) -> LeverageModel:
        """Return the fitted estimator, pooling and scale of a run.

        Parameters
        ----------
        snapshot
            Any version of the dataset.
        run
            The run's name.

        Returns
        -------
        LeverageModel
            Gives uncertainty and leverage of any pairs.

        Raises
        ------
        NotFoundError
            If the dataset has no such run.
        """
        record = snapshot.run_of_any_version(run)
        key = ("model", snapshot.name, run, record.created, record.model)

        def build() -> tuple[LeverageModel, int]:
            archive = snapshot.dataset.runs.model(record)
            model = LeverageModel.from_archive(archive, record.fitted_scale, record.fitted_pooling)
            return model, len(archive)

        return await self._get(key, build)

    async def values(self, snapshot: Snapshot, run: str) -> pa.Table:
        """Return what a run says of every pair.

        Parameters
        ----------
        snapshot
            The dataset's version that the run was made from.
        run
            The run's name.

        Returns
        -------
        pa.Table
            A row for each pair, in the order of the pairs.

        Raises
        ------
        NotFoundError, ConflictError
            As `Snapshot.run` does.
        """
        record = snapshot.run(run)
        key = ("values", snapshot.name, snapshot.version, record.created, run)

        def build() -> tuple[pa.Table, int]:
            table = snapshot.dataset.runs.values(run).combine_chunks()
            return table, table.nbytes

        return await self._get(key, build)

    async def pairs(self, snapshot: Snapshot) -> Pairs:
        """Return all pairs of a dataset.

        Parameters
        ----------
        snapshot
            The dataset.

        Returns
        -------
        Pairs
            In their order.
        """

        def build() -> tuple[Pairs, int]:
            pairs = snapshot.dataset.pairs()
            return pairs, pairs.states.nbytes + pairs.actions.nbytes + 16 * len(pairs)

        return await self._get(("pairs", snapshot.name, snapshot.version), build)

    def names(self) -> list[str]:
        """Return the names of all datasets."""
        return self.store.names()

    def lacks(self, name: str) -> bool:
        """Tell, without reading a file, that there is no dataset of a name.

        Parameters
        ----------
        name
            The dataset's.

        Returns
        -------
        bool
            False if there is one, and for an object store, where looking takes a request.
        """
        local = self.store.folder.local
        return local is not None and not (local / check_name("dataset", name)).is_dir()

    def remove(self, name: str) -> None:
        """Delete a dataset with its runs.

        Parameters
        ----------
        name
            The dataset's.

        Raises
        ------
        NotFoundError
            If there is none.
        ConflictError
            While it is written to.
        """
        self._check_deleted(name, lambda: self.store.delete(name))
        self._forget(name)

    def sweep(self) -> None:
        """Complete or remove what killed writers left behind."""
        self.store.sweep()

    @property
    def store_folder(self) -> Path | None:
        """The folder that the store is in; None for an object store, or if it is not there yet."""
        local = self.store.folder.local
        return local if local is not None and local.is_dir() else None

    def ready(self) -> bool:
        """Tell whether the store can be listed and its first dataset read."""
        try:
            return all((self.store.folder / name).exists(CARD) for name in self.names()[:1])
        except (OSError, SsilDataError):
            return False

    def _open(self, name: str) -> Snapshot:
        return self._check_deleted(name, lambda: Snapshot.of(self.store[name]))

    async def _get(self, key: tuple[Any, ...], build: Callable[[], tuple[Any, int]]) -> Any:
        return await self.cache.get(key, lambda: self._check_deleted(key[1], build))

    def _check_deleted(self, name: str, work: Callable[[], Found]) -> Found:
        """Do what reads a dataset; if it fails because the dataset is deleted, say so."""
        try:
            return work()
        except SsilDataError:
            if name in self.store:
                raise
            self._forget(name)
            raise NotFoundError(f"dataset: the store has none named {name!r}") from None

    def _forget(self, name: str) -> None:
        self._newest.pop(name, None)
        self.cache.forget(lambda key: key[1] == name)

    def _token(self, name: str) -> Any:
        """Return a value that changes with the dataset; taken before the dataset is read."""
        now = time.time()
        logs = _log_folders(self.store.folder.local, name)
        if not logs:
            return int(now / _TRUSTED_SECONDS)
        times = [_modification_time(log, now) for log in logs]
        # the next change might have the same time as one that fresh: such a token equals no other
        return secrets.token_bytes(8) if None in times else tuple(times)


@lru_cache(1024)
def _log_folders(store: Path | None, name: str) -> tuple[Path, ...]:
    """Return the folders of a dataset's logs; cached, as every query looks at them."""
    if store is None:
        return ()
    return tuple(store / name / table / "_delta_log" for table in ("episodes", "leverage"))


def _modification_time(folder: Path, now: float) -> tuple[int, int] | None:
    """Return what tells a change from the next; None if it is too fresh for that."""
    try:
        found = folder.stat()
    except OSError:
        return (0, 0)
    return None if now - found.st_mtime < _SETTLED_SECONDS else (found.st_ino, found.st_mtime_ns)


def _open_field(snapshot: Snapshot, run: str) -> tuple[LeverageField, int]:
    """Return a field and its size; it is queried once, so that it is packed for the next query."""
    field = snapshot.dataset.field(run)
    field.lcor(field.states[:1])
    if 0 < int(field.labeled.sum()) < len(field.labeled):
        field.cor(field.states[:1])
    return field, 2 * field.states.nbytes + _sample_bytes(field)


def _sample_bytes(field: LeverageField) -> int:
    """Return the bytes that a field may take for its random samples."""
    return field.states.nbytes + 16 * len(field.states)
