"""A dataset of a service: the methods of the local one, over REST."""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data.client.connection import Connection
from ssil_data.client.field import RemoteField, RemoteModel
from ssil_data.client.jobs import RemoteJob
from ssil_data.client.pages import read_pages, read_table
from ssil_data.client.runs import RemoteRuns, run_path
from ssil_data.client.upload import episodes_body
from ssil_data.client.wire import ARROW, IDEMPOTENCY, matrix_of_rows, pairs_of_table
from ssil_data.demonstrations import Episode, Pairs, join_pairs
from ssil_data.errors import InvalidInputError
from ssil_data.estimators import Estimator
from ssil_data.json_kinds import to_python_number
from ssil_data.kernels import check_alpha
from ssil_data.scoring import Progress, Recipe, preset
from ssil_data.store.episodes import check_episode, check_labeled, repeat_per_pair
from ssil_data.store.run_record import Run


class RemoteDataset:
    """One version of a dataset at a service: what was in it when it was opened.

    Parameters
    ----------
    connection
        To the service.
    summary
        The dataset as `GET /v1/datasets/{dataset}` shows it.
    limits
        What the service takes at most, as `GET /v1/limits` shows it.

    Examples
    --------
    >>> drives = remote["drives"]
    >>> len(drives) == len(dataset), drives.version == dataset.version
    (True, True)
    >>> bool((drives.labeled().states == dataset.labeled().states).all())
    True
    """

    def __init__(
        self, connection: Connection, summary: Mapping[str, Any], limits: Mapping[str, Any]
    ) -> None:
        self._connection = connection
        self._summary = summary
        self._limits = limits
        self.name: str = summary["dataset"]
        self.version: str = summary["version"]
        self.path = f"v1/datasets/{self.name}"

    def __repr__(self) -> str:
        """Show name and version."""
        return f"RemoteDataset({self.name!r}, version={self.version!r})"

    def __len__(self) -> int:
        """Count the pairs."""
        return self._summary["pairs"]

    @property
    def state_names(self) -> list[str]:
        """The names of the d state dimensions."""
        return list(self._summary["state_names"])

    @property
    def action_names(self) -> list[str]:
        """The names of the k action dimensions."""
        return list(self._summary["action_names"])

    @property
    def versions(self) -> list[str]:
        """The fingerprints of all versions up to this one, which is the last."""
        listed = self._connection.json("GET", f"{self.path}/versions")["versions"]
        return listed[: listed.index(self.version) + 1]

    def at(self, version: str) -> RemoteDataset:
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
        summary = self._connection.json("GET", self.path, params={"version": version})
        return RemoteDataset(self._connection, summary, self._limits)

    @property
    def card(self) -> str:
        """The dataset's card, Markdown."""
        return self._card

    @cached_property
    def _card(self) -> str:
        return self._connection.request("GET", f"{self.path}/card").text

    @property
    def episodes(self) -> pa.Table:
        """The episodes in order: episode, length, labeled, source, score, tier, ending."""
        return self._episodes

    @cached_property
    def _episodes(self) -> pa.Table:
        return read_table(self._connection, f"{self.path}/episodes", self.version)

    def pairs(self) -> Pairs:
        """Read all pairs into memory."""
        return join_pairs(list(self.batches()))

    def batches(self, *, rows: int | None = None) -> Iterator[Pairs]:
        """Read all pairs in order; episodes may be cut between batches.

        Parameters
        ----------
        rows
            Pairs in a batch; the service may give fewer, and decides without.
        """
        pages = self._read_pages({"limit": rows})
        return map(pairs_of_table, pages)

    def episode(self, number: int) -> Pairs:
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
        check_episode(self.name, self.episodes, number)
        return self._read_pairs({"episode": number})

    def labeled(self) -> Pairs:
        """Read the labeled pairs.

        Raises
        ------
        InvalidInputError
            If there are none.
        """
        check_labeled(self.name, self.episodes)
        return self._read_pairs({"labeled": True})

    def _read_pairs(self, params: Mapping[str, Any]) -> Pairs:
        return join_pairs([pairs_of_table(page) for page in self._read_pages(params)])

    def _read_pages(self, params: Mapping[str, Any]) -> Iterator[pa.Table]:
        return read_pages(self._connection, f"{self.path}/pairs", self.version, params)

    def per_pair(self, column: str) -> NDArray[Any]:
        """Return a column of the episodes table for every pair (n,).

        Parameters
        ----------
        column
            Its name, such as `labeled`.
        """
        return repeat_per_pair(self.episodes, column)

    def read_recorded(self, column: str) -> NDArray[np.float32] | None:
        """Read what was recorded beside every pair, for evaluation and maps only.

        Parameters
        ----------
        column
            `reward` or `position`.

        Returns
        -------
        NDArray or None
            (n,) or (n, 2); None where any pair has none.
        """
        pages = self._read_pages({"recorded": column})
        values = pa.concat_tables(list(pages))[column]
        if values.null_count:
            return None
        return matrix_of_rows(values) if column == "position" else values.to_numpy()

    @property
    def runs(self) -> RemoteRuns:
        """The scoring runs, by name."""
        return RemoteRuns(self._connection, self.name, self.version)

    def leverage(self, run: str) -> NDArray[np.float32]:
        """Read the leverage that a run gave to every pair, (n,) in [0, 1]; 1 is expert-like.

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
        path = f"{run_path(self.name, run)}/leverage"
        values = read_table(self._connection, path, self.version, {"columns": "leverage"})
        return values["leverage"].to_numpy()

    def field(self, run: str, *, alpha: float | None = None) -> RemoteField:
        """Return the leverage field of a run over all states.

        Parameters
        ----------
        run
            The run's name.
        alpha
            Sharpness of the kernel instead of the run's own.

        Raises
        ------
        NotFoundError
            If no run has the name.
        ConflictError
            If the run was made from another version.
        InvalidInputError
            For an alpha at which the kernel cannot be computed.
        """
        record = self.runs[run]
        return RemoteField(
            connection=self._connection,
            path=run_path(self.name, run),
            version=self.version,
            width=len(self.state_names),
            alpha=record.alpha if alpha is None else check_alpha(alpha),
            most_rows=self._limits["query_rows"],
        )

    def model(self, run: str) -> RemoteModel:
        """Return the fitted estimator, pooling and scale of a run of any version.

        Parameters
        ----------
        run
            The run's name.

        Raises
        ------
        NotFoundError
            If no run has the name.
        """
        record = self.runs.of_any_version(run)
        most = self._limits["query_rows"]
        return RemoteModel(self._connection, run_path(self.name, run), record, most)

    def score(
        self,
        recipe: Recipe | Estimator | None = None,
        /,
        *,
        labels: int | None = None,
        seed: int = 0,
        run: str | None = None,
        progress: Progress | None = None,
    ) -> Run:
        """Have the service give every pair a leverage, as `ssil_data.score` does, and wait for it.

        Parameters
        ----------
        recipe
            How: a recipe, or an estimator, which then goes with the quantile scale and nothing
            pooled. Without one, the preset `default` of this version of the library.
        labels
            Fit on only so many labeled pairs, the first ones; None for all.
        seed
            Of the fit. Same seed, same machine, same bytes.
        run
            Name of the run; the estimator's kind, numbered, unless given.
        progress
            Called with what is being done, how much of it is done, and how much there is.

        Returns
        -------
        Run
            The record of the run.

        Raises
        ------
        InvalidInputError
            Without labeled pairs, for fewer than two `labels` or more than there are, or without
            unlabeled pairs where the recipe needs them.
        ConflictError
            If a run of that name exists.
        """
        chosen = preset("default") if recipe is None else Recipe.of(recipe)
        body = {**chosen.to_json(), "labels": labels, "seed": seed, "run": run}
        return self.runs[self.start(body).wait(progress)]

    def rescore(
        self,
        source: RemoteDataset,
        source_run: str,
        /,
        *,
        run: str | None = None,
        progress: Progress | None = None,
    ) -> Run:
        """Have the service give every pair a leverage with what another run fitted.

        Parameters
        ----------
        source
            The dataset of the other run, at the same service.
        source_run
            The other run's name.
        run
            Name of the new run; the estimator's kind, numbered, unless given.
        progress
            Called with what is being done, how much of it is done, and how much there is.

        Returns
        -------
        Run
            The record of the new run.

        Raises
        ------
        NotFoundError
            If `source` has no such run.
        InvalidInputError
            For other widths.
        ConflictError
            If a run of the new name exists.
        """
        if not isinstance(source, RemoteDataset):
            raise InvalidInputError(
                f"source: {source!r} is local; a service scores with runs of its own store only"
            )
        fitted = {"dataset": source.name, "run": source_run}
        return self.runs[self.start({"fitted": fitted, "run": run}).wait(progress)]

    def start(self, body: Mapping[str, Any]) -> RemoteJob:
        """Start a scoring job; it is made once, however often the request is sent.

        Parameters
        ----------
        body
            Of `POST /v1/datasets/{dataset}/runs`; what is None is left out.

        Returns
        -------
        RemoteJob
            To wait for, or to cancel.

        Raises
        ------
        SsilDataError
            If the service refuses the body.
        """
        given = {key: to_python_number(value) for key, value in body.items() if value is not None}
        given["version"] = self.version
        headers = {IDEMPOTENCY: secrets.token_hex(16)}
        job = self._connection.json(
            "POST", f"{self.path}/runs", json=given, headers=headers, repeatable=True
        )
        return RemoteJob(self._connection, job["job"])

    def append(self, episodes: Iterable[Episode]) -> RemoteDataset:
        """Add episodes, numbered on from the last, and return the new version.

        Parameters
        ----------
        episodes
            At least one.

        Returns
        -------
        RemoteDataset
            The new version; this one stays as it is.

        Raises
        ------
        InvalidInputError
            For episodes of another width, or none; nothing is written then.
        ConflictError
            If another writer added episodes meanwhile.
        """
        body = episodes_body(episodes, self.state_names, self.action_names, "")
        summary = self._connection.json(
            "POST",
            f"{self.path}/episodes",
            content=body,
            headers={"Content-Type": ARROW},
            work=True,
        )
        return RemoteDataset(self._connection, summary, self._limits)
