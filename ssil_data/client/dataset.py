"""A dataset and its runs, asked over REST: the surface of the local ones."""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ssil_data import scales
from ssil_data.client.connection import Connection
from ssil_data.client.field import RemoteField, RemoteModel
from ssil_data.client.jobs import RemoteJob
from ssil_data.client.wire import ARROW, IDEMPOTENCY, decode, matrix_of_rows, pairs_of_table
from ssil_data.demonstrations import Episode, Pairs, join_pairs
from ssil_data.errors import ConflictError, InvalidInputError, NotFoundError
from ssil_data.estimators import Estimator, to_json
from ssil_data.kernels import check_alpha
from ssil_data.scales import Scale
from ssil_data.scoring import Progress
from ssil_data.store.arrow_schema import VALUES
from ssil_data.store.folder import check_name
from ssil_data.store.runs import Run


class RemoteDataset:
    """One version of a dataset at a service: what was in it when it was opened."""

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
        """The fingerprints of all versions up to the newest."""
        return self._connection.json("GET", f"{self.path}/versions")["versions"]

    def at(self, version: str) -> RemoteDataset:
        """Open an earlier version by its fingerprint; raises NotFoundError."""
        summary = self._connection.json("GET", self.path, params={"version": version})
        return RemoteDataset(self._connection, summary, self._limits)

    @cached_property
    def card(self) -> str:
        """The dataset's card, Markdown."""
        return self._connection.request("GET", f"{self.path}/card").text

    @cached_property
    def episodes(self) -> pa.Table:
        """The episodes in order: episode, length, labeled, source, score, tier, ending."""
        return self._table(f"{self.path}/episodes", {})

    def pairs(self) -> Pairs:
        """Read all pairs into memory."""
        return join_pairs(list(self.batches()))

    def batches(self) -> Iterator[Pairs]:
        """Read all pairs in order, a page at a time."""
        return map(pairs_of_table, self._pages(f"{self.path}/pairs", {}))

    def episode(self, number: int) -> Pairs:
        """Read the pairs of one episode; raises NotFoundError."""
        if not 0 <= number < len(self.episodes):
            raise NotFoundError(
                f"episode of {self.name}: expected 0 to {len(self.episodes) - 1}, found {number}"
            )
        return pairs_of_table(self._table(f"{self.path}/pairs", {"episode": number}))

    def labeled(self) -> Pairs:
        """Read the labeled pairs; raises InvalidInputError if there are none."""
        found = pairs_of_table(self._table(f"{self.path}/pairs", {"labeled": "true"}))
        if not len(found):
            raise InvalidInputError(
                f"labeled episodes of {self.name}: expected at least one, found none among "
                f"{len(self.episodes)}"
            )
        return found

    def per_pair(self, column: str) -> NDArray[Any]:
        """Return a column of the episodes table, such as `labeled`, for every pair (n,)."""
        values = self.episodes[column].to_numpy()
        return np.repeat(values, self.episodes["length"].to_numpy())

    def read_recorded(self, column: str) -> NDArray[np.float32] | None:
        """Read `reward` (n,) or `position` (n, 2) of every pair; None where any has none."""
        values = self._table(f"{self.path}/pairs", {"recorded": column})[column]
        if values.null_count:
            return None
        return matrix_of_rows(values) if column == "position" else values.to_numpy()

    @property
    def runs(self) -> RemoteRuns:
        """The scoring runs, by name."""
        return RemoteRuns(self._connection, self)

    def leverage(self, run: str) -> NDArray[np.float32]:
        """Read the leverage that a run gave to every pair, (n,) in [0, 1]."""
        columns = {"columns": "leverage"}
        return self._table(f"{self.run_path(run)}/leverage", columns)["leverage"].to_numpy()

    def run_path(self, run: str) -> str:
        """Return where a run is asked for; raises InvalidInputError for what names none."""
        return f"{self.path}/runs/{check_name('run', run)}"

    def field(self, run: str, *, alpha: float | None = None) -> RemoteField:
        """Return the leverage field of a run over all states, with the run's alpha or another."""
        record = self.runs[run]
        return RemoteField(
            connection=self._connection,
            path=self.run_path(run),
            version=self.version,
            width=len(self.state_names),
            alpha=record.alpha if alpha is None else check_alpha(alpha),
            most_rows=self._limits["query_rows"],
        )

    def model(self, run: str) -> RemoteModel:
        """Return the fitted estimator and scale of a run of any version."""
        record = self.runs.of_any_version(run)
        most = self._limits["query_rows"]
        return RemoteModel(self._connection, self.run_path(run), record, most)

    def score(
        self,
        estimator: Estimator,
        *,
        scale: Scale | None = None,
        labeled_is_one: bool = False,
        seed: int = 0,
        run: str | None = None,
        progress: Progress | None = None,
    ) -> Run:
        """Have a run made, as `ssil_data.score` makes one, and wait for it."""
        body: dict[str, Any] = {"estimator": to_json(estimator), "seed": seed}
        body |= {"labeled_is_one": labeled_is_one, "run": run}
        if scale is not None:
            body["scale"] = scales.to_json(scale)
        return self.runs[self.start(body).wait(progress)]

    def rescore(
        self,
        source: RemoteDataset,
        source_run: str,
        *,
        run: str | None = None,
        progress: Progress | None = None,
    ) -> Run:
        """Have every pair scored with what another run fitted, and wait for it."""
        fitted = {"dataset": source.name, "run": source_run}
        return self.runs[self.start({"fitted": fitted, "run": run}).wait(progress)]

    def start(self, body: Mapping[str, Any]) -> RemoteJob:
        """Ask for a run by the body of `POST …/runs` and return the job; asked for once only."""
        known = {key: value for key, value in body.items() if value is not None}
        known["version"] = self.version
        headers = {IDEMPOTENCY: secrets.token_hex(16)}
        job = self._connection.json(
            "POST", f"{self.path}/runs", json=known, headers=headers, repeatable=True
        )
        return RemoteJob(self._connection, job["job"])

    def append(self, episodes: Iterable[Episode]) -> RemoteDataset:
        """Add episodes, numbered on from the last, and return the new version."""
        from ssil_data.client.upload import episodes_body

        body = episodes_body(episodes, self.state_names, self.action_names, "")
        summary = self._connection.json(
            "POST",
            f"{self.path}/episodes",
            content=body,
            headers={"Content-Type": ARROW},
            work=True,
        )
        return RemoteDataset(self._connection, summary, self._limits)

    def _table(self, path: str, params: Mapping[str, Any]) -> pa.Table:
        return pa.concat_tables(list(self._pages(path, params)))

    def _pages(self, path: str, params: Mapping[str, Any]) -> Iterator[pa.Table]:
        """Read a bulk answer of this version from page to page."""
        offset = 0
        while True:
            page = {**params, "version": self.version, "offset": offset}
            answer = self._connection.request(
                "GET", path, params=page, headers={"Accept": ARROW}, work=True
            )
            table = decode(answer.content)
            yield table.replace_schema_metadata(None)
            offset += len(table)
            if offset >= int(answer.headers["X-Total-Count"]) or not len(table):
                return


class RemoteRuns:
    """The runs of one dataset, by name, as one version of it sees them."""

    def __init__(self, connection: Connection, dataset: RemoteDataset) -> None:
        self._connection = connection
        self._dataset = dataset

    def all(self) -> list[Run]:
        """List the runs of every version of the dataset, oldest first."""
        listed = self._connection.json("GET", f"{self._dataset.path}/runs")
        return [Run.from_json(record) for record in listed["runs"]]

    def __iter__(self) -> Iterator[Run]:
        """Go through the runs of this version, oldest first."""
        return (run for run in self.all() if run.dataset_version == self._dataset.version)

    def __getitem__(self, name: str) -> Run:
        """Open a run; raises NotFoundError, or ConflictError if it is another version's."""
        run = self.of_any_version(name)
        if run.dataset_version != self._dataset.version:
            raise ConflictError(
                f"run {name!r}: expected one made from version {self._dataset.version} of "
                f"{self._dataset.name}, found version {run.dataset_version}; score this version"
            )
        return run

    def names(self) -> list[str]:
        """List the names of the runs of every version."""
        return sorted(run.name for run in self.all())

    def of_any_version(self, name: str) -> Run:
        """Open a run whose model is to be used, not its values; raises NotFoundError."""
        return Run.from_json(self._connection.json("GET", self._dataset.run_path(name)))

    def values(self, name: str) -> pa.Table:
        """Read a run's values in the order of the pairs; columns as in `rows.VALUES`."""
        return self._dataset._table(f"{self._dataset.run_path(name)}/leverage", {}).cast(VALUES)
