"""Scoring runs of a dataset: one commit of the leverage table each, with a model beside it.

A run exists when the leverage table's log claims its name. The number of the claim is the digest
of the run's settings file, which holds the digest of its model: the commit pins both, whatever
a killed writer of the same name left behind.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import pyarrow as pa

from ssil_data.errors import ConflictError, DamagedError, NotFoundError
from ssil_data.store.arrow_schema import LEVERAGE, VALUES
from ssil_data.store.delta_table import DataFile, VersionedTable
from ssil_data.store.folder import Folder, check_name


@dataclass(frozen=True)
class Run:
    """The record of one scoring run: what it was made from, how, and what it needs to be used.

    `estimator` and `scale` are settings as JSON objects with their `kind`; `fitted_scale` is the
    scale as fitted; `shift` and `spread` standardise states by all demonstrations; `alpha` is the
    kernel's sharpness chosen for them; `model` is the digest of the fitted estimator's bytes.
    """

    name: str
    dataset: str
    dataset_version: str
    estimator: Mapping[str, Any]
    preset: str | None
    scale: Mapping[str, Any]
    fitted_scale: Mapping[str, Any]
    labeled_is_one: bool
    seed: int
    pairs: int
    labeled: int
    seconds: float
    alpha: float
    shift: Sequence[float]
    spread: Sequence[float]
    created: str
    ssil_data: str
    model: str

    def to_json(self) -> dict[str, Any]:
        """Return the record as it is stored and served: its name under the key `run`."""
        values = asdict(self)
        return {"run": values.pop("name"), **values}

    @classmethod
    def from_json(cls, json: Mapping[str, Any]) -> Run:
        """Read a record from `to_json`'s object."""
        values = dict(json)
        return cls(name=values.pop("run"), **values)


class Runs:
    """The runs of one dataset, by name, as one version of it sees them."""

    def __init__(self, dataset: Folder, version: str) -> None:
        """Look at the runs in a dataset's folder from a version of the dataset."""
        self._folder = dataset
        self._version = version
        self._dataset = dataset.uri.rsplit("/", 1)[-1]

    def _table(self) -> VersionedTable:
        return VersionedTable(self._folder / "leverage")

    def all(self) -> list[Run]:
        """List the runs of every version of the dataset, oldest first."""
        table = self._table()
        records = (self._record(table, name) for name in _names(table))
        return sorted(records, key=lambda run: run.created)

    def __iter__(self) -> Iterator[Run]:
        """Go through the runs of this version, oldest first."""
        return (run for run in self.all() if run.dataset_version == self._version)

    def __getitem__(self, name: str) -> Run:
        """Open a run; raises NotFoundError, or ConflictError if it is another version's."""
        run = self.of_any_version(name)
        if run.dataset_version != self._version:
            raise ConflictError(
                f"run {name!r}: expected one made from version {self._version} of "
                f"{self._dataset}, found version {run.dataset_version}; score this version"
            )
        return run

    def names(self) -> list[str]:
        """List the names of the runs of every version."""
        return _names(self._table())

    def of_any_version(self, name: str) -> Run:
        """Open a run whose model is to be used, not its values; raises NotFoundError."""
        table = self._table()
        if table.find_claim(_claim(check_name("run", name))) is None:
            have = ", ".join(self.names()) or "none"
            raise NotFoundError(f"run of {self._dataset}: expected one of [{have}], found {name!r}")
        return self._record(table, name)

    def values(self, name: str) -> pa.Table:
        """Read a run's values in the order of the pairs; columns as in `rows.VALUES`."""
        self[name]
        table = self._table()
        files: list[DataFile] = [f for f in table.files() if f.partition["run"] == name]
        return pa.Table.from_batches(table.batches(files, VALUES.names), VALUES)

    def model(self, run: Run) -> bytes:
        """Read a run's fitted estimator, safetensors; raises DamagedError."""
        name = f"estimator-{run.model}.safetensors"
        return _check_record(self._models(run.name), name, run.model)

    def free_name(self, name: str) -> str:
        """Return `name`, or the first of `name-2`, `name-3`, … that no run has."""
        table = self._table()
        count, candidate = 1, check_name("run", name)
        while table.find_claim(_claim(candidate)) is not None:
            count += 1
            candidate = f"{name}-{count}"
        return candidate

    def check_unused(self, name: str) -> None:
        """Raise ConflictError if a run of that name exists."""
        if self.free_name(name) != name:
            raise self._name_taken(name)

    def _name_taken(self, name: str) -> ConflictError:
        return ConflictError(f"run of {self._dataset}: expected an unused name, found {name!r}")

    def commit(self, run: Run, model: bytes, values: Iterable[pa.Table]) -> None:
        """Write a run: its model and settings first, then its values in one commit, which shows it.

        `values` are chunks with the columns of `rows.VALUES`, in the order of the pairs.
        Raises ConflictError if the name is taken, or taken by another writer meanwhile.
        """
        table = self._table()
        if table.find_claim(_claim(check_name("run", run.name))) is not None:
            raise self._name_taken(run.name)
        settings = json.dumps(run.to_json(), indent=1, sort_keys=True).encode()
        identity = digest(settings)
        models = self._models(run.name)
        models.write(f"estimator-{run.model}.safetensors", model)
        models.write(f"settings-{identity}.json", settings)
        claim = (_claim(run.name), int(identity, 16))
        table.append(values, partition={"run": run.name}, claim=claim)

    def find_damage(self) -> list[str]:
        """Read all files of all runs and say which are not as they were written."""
        table = self._table()
        found = table.find_damage()
        for name in _names(table):
            try:
                self.model(self._record(table, name))
            except (DamagedError, NotFoundError) as error:
                found.append(str(error))
        return found

    def _models(self, name: str) -> Folder:
        return self._folder / "models" / name

    def _record(self, table: VersionedTable, name: str) -> Run:
        number = table.find_claim(_claim(name))
        if number is None:
            raise DamagedError(f"run {name!r}: expected a claim in the log, found none")
        identity = f"{number:015x}"
        settings = _check_record(self._models(name), f"settings-{identity}.json", identity)
        return Run.from_json(json.loads(settings))


def create(dataset: Folder) -> None:
    """Create the empty leverage table of a new dataset."""
    VersionedTable.create(dataset / "leverage", LEVERAGE, partition=["run"])


def digest(data: bytes) -> str:
    """Return the name of a run's file: 60 bits of SHA-256, which fit a Delta transaction number."""
    return hashlib.sha256(data).hexdigest()[:15]


def _names(table: VersionedTable) -> list[str]:
    """List the runs of one look at the table; another look may see one more."""
    return sorted({file.partition["run"] for file in table.files()})


def _claim(name: str) -> str:
    return f"run:{name}"


def _check_record(folder: Folder, name: str, expected: str) -> bytes:
    data = folder.read(name)
    if digest(data) != expected:
        raise DamagedError(f"{folder.uri}/{name}: expected {expected}, found {digest(data)}")
    return data
