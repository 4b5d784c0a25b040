"""The store as the service sees it: newest versions without restart, and a bounded memory."""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa

from ssil_data.demonstrations import Pairs
from ssil_data.errors import NotFoundError, SsilDataError
from ssil_data.field import LeverageField
from ssil_data.scoring import LeverageModel
from ssil_data.store import Store
from ssil_data.store.dataset import CARD, Dataset
from ssil_data.store.folder import check_name
from ssil_data.store.run_record import Run
from ssil_data.store.version_rule import check_version
from ssil_service.queries.cache import Cache

_SETTLED = 0.1
"""Seconds after which a folder's modification time tells the next change from this one."""
_TRUSTED = 2.0
"""Seconds for which an object store, which has no such time, is not asked again."""

Found = TypeVar("Found")


@dataclass(frozen=True)
class Snapshot:
    """One version of a dataset, and its runs at one moment."""

    dataset: Dataset
    runs: dict[str, Run]

    @property
    def name(self) -> str:
        """The dataset's name."""
        return self.dataset.name

    @cached_property
    def version(self) -> str:
        """The dataset's fingerprint."""
        return self.dataset.version

    @cached_property
    def widths(self) -> tuple[int, int]:
        """The widths of states and actions."""
        return len(self.dataset.state_names), len(self.dataset.action_names)

    def run(self, name: str) -> Run:
        """Return a run made from this version; raises NotFoundError or ConflictError."""
        record = self.run_of_any_version(name)
        return check_version(record, dataset=self.name, version=self.version)

    def run_of_any_version(self, name: str) -> Run:
        """Return a run; raises NotFoundError."""
        if name not in self.runs:
            have = ", ".join(sorted(self.runs)[:20]) or "none"
            raise NotFoundError(f"run of {self.name}: expected one of [{have}], found another")
        return self.runs[name]

    @classmethod
    def of(cls, dataset: Dataset) -> Snapshot:
        """Look at the runs of an opened dataset."""
        _ = dataset.version, dataset.episodes  # read now, in the thread that opens it
        return cls(dataset, {run.name: run for run in dataset.runs.all()})


class Catalog:
    """Snapshots of datasets, as new as the store, and what was read of them lately."""

    def __init__(self, store: Store, cache_bytes: int) -> None:
        self.store = store
        self.cache = Cache(cache_bytes)
        self._newest: dict[str, tuple[Any, Snapshot]] = {}

    async def snapshot(self, name: str, version: str | None = None) -> Snapshot:
        """Return the newest version of a dataset, or the given one; raises NotFoundError."""
        token = self._token(check_name("dataset", name))
        known = self._newest.get(name)
        if known is None or known[0] != token:
            newest = await asyncio.to_thread(self._open, name)
            self._newest[name] = (token, newest)
            while len(self._newest) > 256:
                del self._newest[next(iter(self._newest))]
        else:
            newest = known[1]
        if version is None or version == newest.version:
            return newest
        key = ("version", name, newest.version, token, version)
        return await self._cached(key, lambda: (Snapshot.of(newest.dataset.at(version)), 4096))

    def _open(self, name: str) -> Snapshot:
        return self._check_deleted(name, lambda: Snapshot.of(self.store[name]))

    async def read(self, snapshot: Snapshot, work: Callable[[Dataset], Found]) -> Found:
        """Return what is read of a dataset, in a thread; raises NotFoundError if it is deleted."""
        name, dataset = snapshot.name, snapshot.dataset
        return await asyncio.to_thread(self._check_deleted, name, lambda: work(dataset))

    async def _cached(self, key: tuple[Any, ...], build: Callable[[], tuple[Any, int]]) -> Any:
        return await self.cache.get(key, lambda: self._check_deleted(key[1], build))

    def _check_deleted(self, name: str, work: Callable[[], Found]) -> Found:
        """Tell a dataset that is deleted while it is read from one that is damaged."""
        try:
            return work()
        except SsilDataError:
            if name in self.store:
                raise
            self._forget(name)
            raise NotFoundError(
                f"dataset: expected one of the store's, found no {name!r}"
            ) from None

    def _forget(self, name: str) -> None:
        self._newest.pop(name, None)
        self.cache.forget(lambda key: key[1] == name)

    def _token(self, name: str) -> Any:
        """Return what changes with the dataset: read before it is opened, so never too new."""
        now = time.time()
        logs = _logs(self.store.folder.local, name)
        if not logs:
            return int(now / _TRUSTED)
        times = [_modification_time(log, now) for log in logs]
        # a time so fresh that the next change might share it is like no other
        return secrets.token_bytes(8) if None in times else tuple(times)

    def names(self) -> list[str]:
        """List the datasets."""
        return self.store.names()

    def lacks(self, name: str) -> bool:
        """Tell, without waiting, that no dataset has a name; of an object store this is unknown."""
        local = self.store.folder.local
        return local is not None and not (local / check_name("dataset", name)).is_dir()

    async def field(self, snapshot: Snapshot, run: str, alpha: float | None) -> LeverageField:
        """Return a run's field; one of another sharpness shares the states of the run's own."""
        record = snapshot.run(run)
        key = ("field", snapshot.name, snapshot.version, record.created, run)
        own: LeverageField = await self._cached(key, lambda: _field(snapshot, run))
        if alpha in (None, record.alpha):
            return own
        found = await self._cached((*key, alpha), lambda: (own.at(alpha), _sample_bytes(own)))
        self.cache.peek(key)  # so that the one that holds the states is let go of last
        return found

    async def model(self, snapshot: Snapshot, run: str) -> LeverageModel:
        """Return a run's fitted estimator and scale."""
        record = snapshot.run_of_any_version(run)
        key = ("model", snapshot.name, run, record.created, record.model)

        def build() -> tuple[LeverageModel, int]:
            size = len(snapshot.dataset.runs.model(record))
            return LeverageModel.of_record(snapshot.dataset, record), size

        return await self._cached(key, build)

    async def values(self, snapshot: Snapshot, run: str) -> pa.Table:
        """Return a run's values, in the order of the pairs."""
        record = snapshot.run(run)
        key = ("values", snapshot.name, snapshot.version, record.created, run)

        def build() -> tuple[pa.Table, int]:
            table = snapshot.dataset.runs.values(run).combine_chunks()
            return table, table.nbytes

        return await self._cached(key, build)

    async def pairs(self, snapshot: Snapshot) -> Pairs:
        """Return all pairs of a dataset."""

        def build() -> tuple[Pairs, int]:
            pairs = snapshot.dataset.pairs()
            return pairs, pairs.states.nbytes + pairs.actions.nbytes + 16 * len(pairs)

        return await self._cached(("pairs", snapshot.name, snapshot.version), build)

    def remove(self, name: str) -> None:
        """Delete a dataset; raises NotFoundError, or ConflictError while somebody writes to it."""
        self._check_deleted(name, lambda: self.store.delete(name))
        self._forget(name)

    def sweep(self) -> None:
        """Finish what killed writers began."""
        self.store.sweep()

    def ready(self) -> bool:
        """Tell whether the store can be listed and what is listed has cards."""
        try:
            return all((self.store.folder / name).exists(CARD) for name in self.names()[:1])
        except (OSError, SsilDataError):
            return False


@lru_cache(1024)
def _logs(store: Path | None, name: str) -> tuple[Path, ...]:
    """Return the folders of a dataset's logs, which are looked at for every question."""
    if store is None:
        return ()
    return tuple(store / name / table / "_delta_log" for table in ("episodes", "leverage"))


def _modification_time(folder: Path, now: float) -> tuple[int, int] | None:
    try:
        found = folder.stat()
    except OSError:
        return (0, 0)
    return None if now - found.st_mtime < _SETTLED else (found.st_ino, found.st_mtime_ns)


def _field(snapshot: Snapshot, run: str) -> tuple[LeverageField, int]:
    field = snapshot.dataset.field(run)
    field.lcor(field.states[:1])  # packs the states, so that no question waits for it
    if 0 < int(field.labeled.sum()) < len(field.labeled):
        field.cor(field.states[:1])
    return field, 2 * field.states.nbytes + _sample_bytes(field)


def _sample_bytes(field: LeverageField) -> int:
    """Return the bytes that a field may take for its samples, which it makes for itself."""
    return field.states.nbytes + 16 * len(field.states)
