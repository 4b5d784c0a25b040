"""The demonstration store: a folder, or a prefix of an object store, of datasets."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from ssil_data.demonstrations import Episode
from ssil_data.errors import ConflictError, NotFoundError
from ssil_data.store import runs
from ssil_data.store.arrow_schema import EPISODES, pairs_schema
from ssil_data.store.dataset import CARD, Dataset
from ssil_data.store.delta_table import VersionedTable
from ssil_data.store.folder import Folder, check_name

_HIDDEN = ".unfinished-"
"""Begins the names of folders that are being built, or deleted, and belong to no dataset."""
_PARTS = frozenset({"pairs", "episodes", "leverage", "models"})


class Store:
    """Datasets by name; a dataset exists when its card does, which is written last.

    On disk, who builds, writes to or deletes a dataset holds a lock on its folder, in whatever
    process: it is free again when that process ends. An object store has no such locks.
    """

    def __init__(self, location: str | Path) -> None:
        """Point at a folder or URI; a new store appears with its first dataset."""
        self.folder = Folder(location)

    def __repr__(self) -> str:
        """Show the location."""
        return f"Store({self.folder.uri!r})"

    def __contains__(self, name: str) -> bool:
        """Tell whether a dataset of that name exists."""
        return (self.folder / check_name("dataset", name)).exists(CARD)

    def __iter__(self) -> Iterator[Dataset]:
        """Go through the datasets in the order of their names."""
        return (self[name] for name in self.names())

    def __getitem__(self, name: str) -> Dataset:
        """Open the newest version of a dataset; raises NotFoundError."""
        if name not in self:
            raise self._no_such_dataset(name)
        return Dataset(self.folder / name)

    def names(self) -> list[str]:
        """List the datasets."""
        visible = [name for name in self.folder.names() if not name.startswith(".")]
        return [name for name in visible if (self.folder / name).exists(CARD)]

    def create(
        self,
        name: str,
        episodes: Iterable[Episode],
        *,
        state_names: Sequence[str],
        action_names: Sequence[str],
        card: str = "",
    ) -> Dataset:
        """Write a new dataset; it appears whole, at the end, or not at all.

        On disk it is built in a hidden folder and renamed. The files' checksums are added to the
        card. Raises ConflictError if the name is
        taken, InvalidInputError for episodes of another width or none.
        """
        if name in self:
            raise self._name_taken(name)
        final = self.folder / name
        with self._build_folder(final) as built:
            VersionedTable.create(built / "pairs", pairs_schema(state_names, action_names))
            VersionedTable.create(built / "episodes", EPISODES)
            runs.create(built)
            dataset = Dataset(built).append(episodes)
            built.write(CARD, f"{card.rstrip()}\n\n{dataset.checksums()}".encode())
            if built is not final:
                self._publish(built, final)
        return Dataset(final)

    @contextmanager
    def open_for_writing(self, name: str) -> Iterator[Dataset]:
        """Open a dataset that nobody deletes meanwhile; several may write to it at once.

        Raises NotFoundError, or ConflictError if it is being deleted.
        """
        with self._lock_dataset(name, alone=False):
            yield self[name]

    def delete(self, name: str) -> None:
        """Delete a dataset with its runs: gone at once under its name, then from the disk.

        In an object store it goes file by file. Raises NotFoundError, or ConflictError while
        somebody is `writing` to it.
        """
        with self._lock_dataset(name, alone=True):
            removed = folder = self.folder / name
            if folder.local is not None:
                removed = self._hidden_folder()
                if not folder.rename(removed):
                    raise self._no_such_dataset(name)
            removed.delete()

    def sweep(self) -> None:
        """Delete what a `create` or a `delete` that was killed left on the disk."""
        for name in self.folder.names() if self.folder.local is not None else []:
            left = self.folder / name
            if name.startswith(_HIDDEN) and left.local is not None:
                with suppress(OSError), ExitStack() as held:
                    with self._exclusive():
                        held.enter_context(_lock(left.local, alone=True))
                    left.delete()

    @contextmanager
    def _build_folder(self, final: Folder) -> Iterator[Folder]:
        """Give the folder to build a dataset in; what is left there by an error is deleted."""
        built = final if final.local is None else self._hidden_folder()
        with ExitStack() as held:
            if built.local is None:
                built.delete()
            else:
                self.folder.make()
                with self._exclusive():
                    built.make()
                    held.enter_context(_lock(built.local, alone=False))
            try:
                yield built
            except BaseException:
                built.delete()
                raise

    def _publish(self, built: Folder, final: Folder) -> None:
        """Give a whole dataset its name; what an unlocked writer left of a deleted one goes."""
        name = final.uri.rsplit("/", 1)[-1]
        with self._exclusive():
            removed = self._hidden_folder()
            remains = final.exists() and set(final.names()) <= _PARTS
            if remains and not final.rename(removed):
                raise self._name_taken(name)
            if not built.rename(final):
                raise self._name_taken(name)
        with suppress(OSError):  # a sweep elsewhere may be at it
            removed.delete()

    @contextmanager
    def _lock_dataset(self, name: str, *, alone: bool) -> Iterator[None]:
        if name not in self:
            raise self._no_such_dataset(name)
        with ExitStack() as held:
            folder = (self.folder / name).local
            try:
                if folder is not None:
                    held.enter_context(_lock(folder, alone=alone))
            except BlockingIOError:
                found = "somebody writing to it" if alone else "it being deleted"
                raise ConflictError(f"dataset {name!r}: expected it free, found {found}") from None
            except FileNotFoundError:
                raise self._no_such_dataset(name) from None
            yield

    @contextmanager
    def _exclusive(self) -> Iterator[None]:
        """Hold the lock under which names are given and hidden folders are taken."""
        assert self.folder.local is not None
        with _lock(self.folder.local, alone=True, wait=True):
            yield

    def _hidden_folder(self) -> Folder:
        return self.folder / f"{_HIDDEN}{secrets.token_hex(8)}"

    def _name_taken(self, name: str) -> ConflictError:
        return ConflictError(
            f"dataset: the name {name!r} is taken in {self.folder.uri}; give another"
        )

    def _no_such_dataset(self, name: str) -> NotFoundError:
        have = ", ".join(self.names()) or "none"
        return NotFoundError(
            f"dataset: expected one of [{have}] in {self.folder.uri}, found {name!r}"
        )


@contextmanager
def _lock(folder: Path, *, alone: bool, wait: bool = False) -> Iterator[None]:
    """Hold a folder, alone or with others, until the process ends or the folder is let go.

    Raises BlockingIOError where it is held, FileNotFoundError where it is another by now.
    """
    try:
        import fcntl
    except ImportError:  # a system without it has one writer at a time
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        kind = fcntl.LOCK_EX if alone else fcntl.LOCK_SH
        fcntl.flock(handle, kind if wait else kind | fcntl.LOCK_NB)
        if not os.path.samestat(os.fstat(handle), folder.stat()):
            raise FileNotFoundError(folder)
        yield
    finally:
        os.close(handle)
