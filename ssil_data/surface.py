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
        """Return the field with another sharpness.

        Parameters
        ----------
        alpha
            The kernel's sharpness, > 0.

        Raises
        ------
        InvalidInputError
            For an alpha at which the kernel cannot be computed.
        """
        ...

    def lcor(self, states: ArrayLike, /, **options: Unpack[LCoROptions]) -> LCoR:
        """Return LCoR of states (equation 5): near 1 is expert-like, near 0 is not.

        Parameters
        ----------
        states
            (m, d) in raw units.
        options
            The fields of `ssil_data.field.LCoRQuery` as keyword arguments.

        Raises
        ------
        InvalidInputError
            For states of another width or not finite, and for options that conflict.
        """
        ...

    def sums(self, states: ArrayLike, /, *, contributors: int = 0) -> Sums:
        """Return the sums that make LCoR of states, which add up over the shards of a store.

        Parameters
        ----------
        states
            (m, d) in raw units.
        contributors
            Also return this many demonstration states that weigh most.

        Raises
        ------
        InvalidInputError
            For states of another width or not finite, and for a negative number.
        """
        ...

    def cor(self, states: ArrayLike, /) -> NDArray[np.float64]:
        """Return CoR of states (equation 2): above 1/2 nearer to the labeled states, else below.

        Parameters
        ----------
        states
            (m, d) in raw units.

        Raises
        ------
        InvalidInputError
            For states of another width or not finite, and where all states are labeled, or none.
        """
        ...


class ModelLike(Protocol):
    """The fitted estimator, pooling and scale of a run."""

    def __call__(self, pairs: Pairs, /) -> Scored:
        """Return uncertainty and leverage of pairs, of the dataset or new ones.

        Parameters
        ----------
        pairs
            In raw units; estimators of windows and poolings need the neighboring rows of an episode
            in the same call: a pair that comes alone is judged alone.

        Raises
        ------
        InvalidInputError
            For pairs of another width.
        """
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
        """Return the record of a run of this version.

        Parameters
        ----------
        name
            The run's name.

        Raises
        ------
        NotFoundError
            If no run has the name.
        ConflictError
            If the run was made from another version.
        """
        ...

    def of_any_version(self, name: str, /) -> Run:
        """Return the record of a run of any version, whose model is to be used.

        Parameters
        ----------
        name
            The run's name.

        Raises
        ------
        NotFoundError
            If no run has the name.
        """
        ...

    def values(self, name: str, /) -> pa.Table:
        """Read the values of a run of this version, in the order of the pairs.

        Parameters
        ----------
        name
            The run's name.

        Returns
        -------
        pyarrow.Table
            episode, step, uncertainty (larger: less like the labeled pairs), its parts aleatoric
            and epistemic, leverage in [0, 1], the uncertainty pooled over time, and a column for
            each member of an ensemble; null where the run has none.
        """
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
        """Open an earlier version.

        Parameters
        ----------
        version
            Its fingerprint.

        Raises
        ------
        NotFoundError
            If no version has the fingerprint.
        """
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
        """Read all pairs in order; episodes may be cut between batches.

        Parameters
        ----------
        rows
            Pairs in a batch at most.
        """
        ...

    def episode(self, number: int, /) -> Pairs:
        """Read the pairs of one episode.

        Parameters
        ----------
        number
            Of the episode.

        Raises
        ------
        NotFoundError
            If no episode has the number.
        """
        ...

    def labeled(self) -> Pairs:
        """Read the labeled pairs; raises InvalidInputError if there are none."""
        ...

    def per_pair(self, column: str, /) -> NDArray[Any]:
        """Return a column of the episodes table for every pair (n,).

        Parameters
        ----------
        column
            Its name, such as `labeled`.
        """
        ...

    def read_recorded(self, column: str, /) -> NDArray[np.float32] | None:
        """Read what was recorded beside every pair; None where any pair has none.

        For evaluation and maps only: no estimator or trainer reads it.

        Parameters
        ----------
        column
            `reward` (n,) or `position` (n, 2).
        """
        ...

    @property
    def runs(self) -> RunsLike:
        """The scoring runs, by name."""
        ...

    def leverage(self, run: str, /) -> NDArray[np.float32]:
        """Read the leverage that a run gave to every pair, (n,) in [0, 1]; 1 is expert-like.

        Parameters
        ----------
        run
            The name of a run of this version.
        """
        ...

    def field(self, run: str, /, *, alpha: float | None = None) -> FieldLike:
        """Return the leverage field of a run over all states.

        Parameters
        ----------
        run
            The name of a run of this version.
        alpha
            Sharpness of the kernel instead of the run's own.
        """
        ...

    def model(self, run: str, /) -> ModelLike:
        """Return the fitted estimator, pooling and scale of a run of any version.

        Parameters
        ----------
        run
            The run's name.
        """
        ...

    def append(self, episodes: Iterable[Episode], /) -> Self:
        """Add episodes, numbered on from the last, and return the new version.

        Parameters
        ----------
        episodes
            At least one.

        Raises
        ------
        InvalidInputError
            For episodes of another width, or none; the dataset is then unchanged.
        ConflictError
            If another writer added episodes meanwhile; the dataset is then unchanged.
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

        Parameters
        ----------
        name
            The dataset's name.
        episodes
            At least one.
        state_names, action_names
            The names of the dimensions.
        card
            Markdown; the files' checksums are added to it.

        Raises
        ------
        ConflictError
            If the name is taken.
        InvalidInputError
            For episodes of another width, or none.
        """
        ...

    def delete(self, name: str, /) -> None:
        """Delete a dataset with its runs.

        Parameters
        ----------
        name
            The dataset's name.

        Raises
        ------
        NotFoundError
            If no dataset has the name.
        ConflictError
            While another process writes to it.
        """
        ...
