"""The demonstration store: a folder, or a prefix of an object store, of datasets."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from ssil_data.demonstrations import Episode
from ssil_data.errors import ConflictError, InvalidInputError, NotFoundError
from ssil_data.store import runs
from ssil_data.store.acknowledged import RECORD
from ssil_data.store.arrow_schema import EPISODES, pairs_schema
from ssil_data.store.card import CARD, write_card
from ssil_data.store.dataset import Dataset
from ssil_data.store.delta_table import VersionedTable
from ssil_data.store.folder import Folder, check_name

_HIDDEN = ".unfinished-"
"""Prefix of folders that are being built or deleted and belong to no dataset."""
_PARTS = frozenset({"pairs", "episodes", "leverage", "models", RECORD})
"""What a writer without a lock can leave of a deleted dataset."""


class Store:
    """Datasets by name, in a folder or below an object store's prefix.

    A dataset exists when its card does, which is written last. On disk, a process that builds,
    writes to or deletes a dataset locks its folder; the lock ends with the process. An object store
    has no such locks.

    Parameters
    ----------
    location
        A path or a URI such as `s3://bucket/prefix`; the store appears with its first dataset.

    Examples
    --------
    >>> store.names()
    ['drives']
    >>> len(store["drives"])
    420
    """

    def __init__(self, location: str | Path) -> None:
        """Point at a folder or URI; nothing is read or created yet."""
        self.folder = Folder(location)

    def __repr__(self) -> str:
        """Show the location."""
        return f"Store({self.folder.uri!r})"

    def __contains__(self, name: str) -> bool:
        """Tell whether a dataset exists.

        Parameters
        ----------
        name
            The dataset's name.
        """
        return (self.folder / check_name("dataset", name)).exists(CARD)

    def __iter__(self) -> Iterator[Dataset]:
        """Go through the datasets in the order of their names."""
        return (self[name] for name in self.names())

    def __getitem__(self, name: str) -> Dataset:
        """Open the newest version of a dataset.

        Parameters
        ----------
        name
            The dataset's name.

        Raises
        ------
        NotFoundError
            If there is none of that name.
        """
        if name not in self:
            raise self._no_such_dataset(name)
        return Dataset(self.folder / name)

    def names(self) -> list[str]:
        """List the names of the datasets, sorted."""
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

        On disk it is built in a hidden folder and renamed.

        Parameters
        ----------
        name
            Of the dataset, unused.
        episodes
            At least one, all of the same widths.
        state_names, action_names
            One name for each dimension.
        card
            Markdown that describes the dataset; the files' checksums are added.

        Returns
        -------
        Dataset
            Its first version.

        Raises
        ------
        ConflictError
            If the name is taken.
        InvalidInputError
            For episodes of another width, or none.
        """
        if name in self:
            raise self._name_taken(name)
        final = self.folder / name
        with self._build_folder(final) as built:
            VersionedTable.create(built / "pairs", pairs_schema(state_names, action_names))
            VersionedTable.create(built / "episodes", EPISODES)
            runs.create(built)
            dataset = Dataset(built).append(episodes)
            write_card(built, f"{card.rstrip()}\n\n{dataset.checksums()}")
            if built is not final:
                self._publish(built, final)
        return Dataset(final)

    @contextmanager
    def open_for_writing(self, name: str) -> Iterator[Dataset]:
        """Open a dataset and keep it from being deleted; several may write to it at once.

        Parameters
        ----------
        name
            The dataset's name.

        Raises
        ------
        NotFoundError
            If there is none of that name.
        ConflictError
            If it is being deleted.
        """
        with self._lock_dataset(name, exclusive=False):
            yield self[name]

    def delete(self, name: str) -> None:
        """Delete a dataset with its runs: at once under its name, then from the disk.

        In an object store it goes file by file.

        Parameters
        ----------
        name
            The dataset's name.

        Raises
        ------
        NotFoundError
            If there is none of that name.
        ConflictError
            While it is open for writing.
        """
        with self._lock_dataset(name, exclusive=True):
            folder = self.folder / name
            removed = folder
            if folder.local is not None:
                removed = self._hidden_folder()
                if not folder.rename(removed):
                    raise self._no_such_dataset(name)
            removed.delete()

    def repair(self, name: str) -> list[str]:
        """Restore what can be of a damaged dataset on disk; what cannot be stays as it is.

        Parameters
        ----------
        name
            The dataset's name.

        Returns
        -------
        list of str
            What was done, one sentence for each file; none where nothing is damaged or can be
            restored.

        Raises
        ------
        NotFoundError
            If there is none of that name.
        ConflictError
            While it is open for writing.
        InvalidInputError
            For an object store, which keeps its own copies.
        """
        from ssil_data.store.repair import repair

        folder = (self.folder / check_name("dataset", name)).local
        if folder is None:
            raise InvalidInputError("repair: only a store on disk can be repaired here")
        with self._lock_dataset(name, exclusive=True):
            return repair(folder)

    def sweep(self) -> None:
        """Delete what a `create` or a `delete` that was killed left on the disk."""
        if self.folder.local is None:
            return
        for name in self.folder.names():
            remains = self.folder / name
            if name.startswith(_HIDDEN) and remains.local is not None:
                with suppress(OSError), ExitStack() as locks:
                    with self._lock_names():
                        locks.enter_context(_lock(remains.local, exclusive=True))
                    remains.delete()

    @contextmanager
    def _build_folder(self, final: Folder) -> Iterator[Folder]:
        """Give the folder to build a dataset in, and delete it after an error."""
        built = final if final.local is None else self._hidden_folder()
        with ExitStack() as locks:
            if built.local is None:
                built.delete()
            else:
                self.folder.make()
                with self._lock_names():
                    built.make()
                    locks.enter_context(_lock(built.local, exclusive=False))
            try:
                yield built
            except BaseException:
                built.delete()
                raise

    def _publish(self, built: Folder, final: Folder) -> None:
        """Rename a whole dataset; what a writer without a lock left of a deleted one is removed."""
        name = final.uri.rsplit("/", 1)[-1]
        with self._lock_names():
            removed = self._hidden_folder()
            remains = final.exists() and set(final.names()) <= _PARTS
            if remains and not final.rename(removed):
                raise self._name_taken(name)
            if not built.rename(final):
                raise self._name_taken(name)
        with suppress(OSError):  # another process's sweep may delete it at the same time
            removed.delete()

    @contextmanager
    def _lock_dataset(self, name: str, *, exclusive: bool) -> Iterator[None]:
        """Lock a dataset's folder, to delete it (exclusive) or to write to it."""
        if name not in self:
            raise self._no_such_dataset(name)
        with ExitStack() as locks:
            folder = (self.folder / name).local
            try:
                if folder is not None:
                    locks.enter_context(_lock(folder, exclusive=exclusive))
            except BlockingIOError:
                use = "written to" if exclusive else "deleted"
                raise ConflictError(f"dataset {name!r} is being {use}; try again later") from None
            except FileNotFoundError:
                raise self._no_such_dataset(name) from None
            yield

    @contextmanager
    def _lock_names(self) -> Iterator[None]:
        """Hold the lock under which datasets get names and hidden folders are made and removed."""
        assert self.folder.local is not None
        with _lock(self.folder.local, exclusive=True, wait=True):
            yield

    def _hidden_folder(self) -> Folder:
        return self.folder / f"{_HIDDEN}{secrets.token_hex(8)}"

    def _name_taken(self, name: str) -> ConflictError:
        return ConflictError(
            f"dataset: the name {name!r} is taken in {self.folder.uri}; give another, "
            "append to it, or delete it first"
        )

    def _no_such_dataset(self, name: str) -> NotFoundError:
        have = ", ".join(self.names()) or "none"
        return NotFoundError(
            f"dataset: expected one of [{have}] in {self.folder.uri}, found {name!r}"
        )


@contextmanager
def _lock(folder: Path, *, exclusive: bool, wait: bool = False) -> Iterator[None]:
    """Lock a folder, exclusively or shared, until the block or the process ends.

    Raises BlockingIOError where another process has it, FileNotFoundError where the folder was
    replaced meanwhile.
    """
    try:
        import fcntl
    except ImportError:  # a system without it has one writer at a time
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        kind = fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH
        fcntl.flock(handle, kind if wait else kind | fcntl.LOCK_NB)
        if not os.path.samestat(os.fstat(handle), folder.stat()):
            raise FileNotFoundError(folder)
        yield
    finally:
        os.close(handle)
