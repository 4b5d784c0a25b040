"""What a store offers, whether it is a folder or behind a service: the types of both.

A local store (`ssil_data.Store`) and one behind a service (`ssil_data.connect`) have the members
below, with the same numbers to the last bit on the same processor and the same errors for the same
mistakes; `tests/ssil_data/test_surface.py` holds both against one list of expectations. Code that
takes either is typed with these protocols. What only one of them has is no part of them. Runs are
made by functions that take either: `ssil_data.score` and `ssil_data.rescore`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar, Unpack

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa
    from numpy.typing import ArrayLike, NDArray

    from ssil_data.demonstrations import Episode, Pairs
    from ssil_data.field import LCoR, LCoROptions
    from ssil_data.kernels import Sums
    from ssil_data.leverage_model import Scored
    from ssil_data.store.run_record import Run


class FieldLike(Protocol):
    """The leverage field of a run: LCoR and CoR of any state, over all demonstrations."""

    @property
    def alpha(self) -> float:
        """The kernel's sharpness: the larger, the fewer demonstrations a value rests on."""
        ...

    def at(self, alpha: float, /) -> Self:
        """Return the field with another sharpness."""
        ...

    def lcor(self, states: ArrayLike, /, **options: Unpack[LCoROptions]) -> LCoR:
        """Return LCoR of states (m, d) in raw units: near 1 expert-like, near 0 not (equation 5).

        Options are the fields of `ssil_data.field.LCoRQuery`.
        """
        ...

    def sums(self, states: ArrayLike, /, *, contributors: int = 0) -> Sums:
        """Return the sums that make LCoR of states (m, d), which add up over shards."""
        ...

    def cor(self, states: ArrayLike, /) -> NDArray[np.float64]:
        """Return CoR of states (m, d), (m,) in [0, 1]: above 1/2 nearer to the labeled states."""
        ...


class ModelLike(Protocol):
    """The fitted estimator and scale of a run."""

    def __call__(self, pairs: Pairs, /) -> Scored:
        """Return uncertainty and leverage of pairs, of the dataset or new ones."""
        ...


class RunsLike(Protocol):
    """The scoring runs of a dataset, by name, as one version of it sees them.

    The values of a run belong to the version it was made from; its record and its model may be used
    for any version.
    """

    def all(self) -> list[Run]:
        """List the runs of every version of the dataset, oldest first."""
        ...

    def names(self) -> list[str]:
        """List the names of the runs of every version, sorted."""
        ...

    def __iter__(self) -> Iterator[Run]:
        """Go through the runs of this version, oldest first."""
        ...

    def __getitem__(self, name: str, /) -> Run:
        """Return a run of this version; NotFoundError, or ConflictError for another version's."""
        ...

    def of_any_version(self, name: str, /) -> Run:
        """Return a run of any version; raises NotFoundError."""
        ...

    def values(self, name: str, /) -> pa.Table:
        """Read a run's values: episode, step, uncertainty, aleatoric, epistemic, leverage."""
        ...


class DatasetLike(Protocol):
    """One version of a dataset: what was in it when it was opened."""

    @property
    def name(self) -> str:
        """The dataset's name."""
        ...

    @property
    def version(self) -> str:
        """The fingerprint of the version, 16 hexadecimal digits."""
        ...

    @property
    def versions(self) -> list[str]:
        """The fingerprints of all versions up to this one, which is the last."""
        ...

    def at(self, version: str, /) -> Self:
        """Open an earlier version by its fingerprint; raises NotFoundError."""
        ...

    def __len__(self) -> int:
        """Count the pairs."""
        ...

    @property
    def state_names(self) -> list[str]:
        """The names of the d state dimensions."""
        ...

    @property
    def action_names(self) -> list[str]:
        """The names of the k action dimensions."""
        ...

    @property
    def card(self) -> str:
        """The dataset's card, Markdown."""
        ...

    @property
    def episodes(self) -> pa.Table:
        """The episodes in order: episode, length, labeled, source, score, tier, ending."""
        ...

    def pairs(self) -> Pairs:
        """Read all pairs into memory."""
        ...

    def batches(self, *, rows: int = ...) -> Iterator[Pairs]:
        """Read all pairs in order, at most `rows` at a time; episodes may be cut in between."""
        ...

    def episode(self, number: int, /) -> Pairs:
        """Read the pairs of one episode; raises NotFoundError."""
        ...

    def labeled(self) -> Pairs:
        """Read the labeled pairs; raises InvalidInputError if there are none."""
        ...

    def per_pair(self, column: str, /) -> NDArray[Any]:
        """Return a column of the episodes table, such as `labeled`, for every pair (n,)."""
        ...

    def read_recorded(self, column: str, /) -> NDArray[np.float32] | None:
        """Read `reward` (n,) or `position` (n, 2) of every pair; None where any has none.

        For evaluation and maps only: no estimator or trainer reads them.
        """
        ...

    @property
    def runs(self) -> RunsLike:
        """The scoring runs, by name."""
        ...

    def leverage(self, run: str, /) -> NDArray[np.float32]:
        """Read the leverage that a run gave to every pair, (n,) in [0, 1]; 1 is expert-like."""
        ...

    def field(self, run: str, /, *, alpha: float | None = None) -> FieldLike:
        """Return the leverage field of a run over all states, with the run's alpha or another."""
        ...

    def model(self, run: str, /) -> ModelLike:
        """Return the fitted estimator and scale of a run of any version; raises NotFoundError."""
        ...

    def append(self, episodes: Iterable[Episode], /) -> Self:
        """Add episodes, numbered on from the last, and return the new version.

        Raises InvalidInputError for other widths or no episode, ConflictError if another writer
        added episodes meanwhile; the dataset is then unchanged.
        """
        ...


D_co = TypeVar("D_co", bound=DatasetLike, covariant=True)


class StoreLike(Protocol[D_co]):
    """Datasets by name."""

    def names(self) -> list[str]:
        """List the names of the datasets, sorted."""
        ...

    def __contains__(self, name: str, /) -> bool:
        """Tell whether a dataset of that name exists."""
        ...

    def __iter__(self) -> Iterator[D_co]:
        """Go through the datasets in the order of their names."""
        ...

    def __getitem__(self, name: str, /) -> D_co:
        """Open the newest version of a dataset; raises NotFoundError."""
        ...

    def create(
        self,
        name: str,
        /,
        episodes: Iterable[Episode],
        *,
        state_names: Sequence[str],
        action_names: Sequence[str],
        card: str = "",
    ) -> D_co:
        """Write a new dataset; it appears whole, at the end, or not at all.

        Raises ConflictError if the name is taken, InvalidInputError for episodes of another width
        or none.
        """
        ...

    def delete(self, name: str, /) -> None:
        """Delete a dataset with its runs; raises NotFoundError, or ConflictError while in use."""
        ...
