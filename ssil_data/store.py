"""The demonstration store: a folder, or a prefix of an object store, of datasets."""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from ssil_data import runs
from ssil_data.dataset import CARD, Dataset
from ssil_data.demonstrations import Episode
from ssil_data.errors import ConflictError, NotFoundError
from ssil_data.rows import EPISODES, pairs_schema
from ssil_data.storage import Folder, checked_name
from ssil_data.tables import Table


class Store:
    """Datasets by name; a dataset exists when its card does, which is written last."""

    def __init__(self, location: str | Path) -> None:
        """Point at a folder or URI; a new store appears with its first dataset."""
        self.folder = Folder(location)

    def __repr__(self) -> str:
        """Show the location."""
        return f"Store({self.folder.uri!r})"

    def __contains__(self, name: str) -> bool:
        """Tell whether a dataset of that name exists."""
        return (self.folder / checked_name("dataset", name)).exists(CARD)

    def __iter__(self) -> Iterator[Dataset]:
        """Go through the datasets in the order of their names."""
        return (self[name] for name in self.names())

    def __getitem__(self, name: str) -> Dataset:
        """Open the newest version of a dataset; raises NotFoundError."""
        if name not in self:
            have = ", ".join(self.names()) or "none"
            raise NotFoundError(
                f"dataset: expected one of [{have}] in {self.folder.uri}, found {name!r}"
            )
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
        taken = ConflictError(
            f"dataset: expected an unused name in {self.folder.uri}, found {name!r}"
        )
        if name in self:
            raise taken
        final = self.folder / name
        hidden = self.folder / f".{name}.{secrets.token_hex(4)}"
        built = final if final.local is None else hidden
        built.delete()
        try:
            Table.create(built / "pairs", pairs_schema(state_names, action_names))
            Table.create(built / "episodes", EPISODES)
            runs.create(built)
            dataset = Dataset(built).append(episodes)
            built.write(CARD, f"{card.rstrip()}\n\n{dataset.checksums()}".encode())
            if built is hidden and not hidden.rename(final):
                raise taken
        except BaseException:
            built.delete()
            raise
        return Dataset(final)
