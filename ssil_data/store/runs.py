"""Scoring runs of a dataset: one commit of the leverage table each, with a model beside it.

A run exists when the leverage table's log claims its name. The number of the claim is the digest
of the run's settings file, which holds the digest of its model: the commit pins both, whatever
a killed writer of the same name left behind.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator

import pyarrow as pa

from ssil_data.errors import ConflictError, DamagedError, InvalidInputError, NotFoundError
from ssil_data.store.arrow_schema import LEVERAGE, VALUES, fill_columns
from ssil_data.store.delta_table import DataFile, VersionedTable
from ssil_data.store.folder import Folder, check_name
from ssil_data.store.run_record import Run, find_misfit
from ssil_data.store.version_rule import check_version, select_version


class Runs:
    """The runs of one dataset, by name, as one version of it sees them."""

    def __init__(self, dataset: Folder, version: str) -> None:
        """Look at a dataset's runs from one of its versions; nothing is read yet.

        Parameters
        ----------
        dataset
            The dataset's folder.
        version
            The fingerprint of the version.
        """
        self._folder = dataset
        self._version = version
        self._dataset = dataset.uri.rsplit("/", 1)[-1]

    def _open_table(self) -> VersionedTable:
        """Open the newest state of the table; every operation opens it once and looks at that."""
        return VersionedTable(self._folder / "leverage")

    def all(self) -> list[Run]:
        """List the runs of every version of the dataset, oldest first."""
        table = self._open_table()
        records = [self._read_record(table, name) for name in _names(table)]
        return sorted(records, key=lambda run: run.created)

    def __iter__(self) -> Iterator[Run]:
        """Go through the runs of this version, oldest first."""
        return iter(select_version(self.all(), self._version))

    def __getitem__(self, name: str) -> Run:
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
        return self._check_version(self._find(self._open_table(), name))

    def names(self) -> list[str]:
        """List the names of the runs of every version, sorted."""
        return _names(self._open_table())

    def of_any_version(self, name: str) -> Run:
        """Return the record of a run whose model is to be used, not its values.

        Parameters
        ----------
        name
            The run's name.

        Raises
        ------
        NotFoundError
            If no run has the name.
        """
        return self._find(self._open_table(), name)

    def values(self, name: str) -> pa.Table:
        """Read a run's values in the order of the pairs.

        Parameters
        ----------
        name
            The run's name.

        Returns
        -------
        pa.Table
            A table of n rows with the columns of `arrow_schema.VALUES`.

        Raises
        ------
        NotFoundError
            If no run has the name.
        ConflictError
            If the run was made from another version.
        DamagedError
            Where bytes are not those that were written.
        """
        table = self._open_table()
        self._check_version(self._find(table, name))
        files = [file for file in table.files() if _run_of(file) == name]
        known = [name for name in VALUES.names if name in table.schema.names]
        read = pa.Table.from_batches(list(table.batches(files, known)))
        return fill_columns(read)

    def model(self, run: Run) -> bytes:
        """Read a run's fitted estimator, safetensors.

        Parameters
        ----------
        run
            The record of a run of any version.

        Raises
        ------
        DamagedError
            Where the bytes are not those that were written.
        """
        name = f"estimator-{run.model}.safetensors"
        return _read_checked(self._models(run.name), name, run.model)

    def free_name(self, name: str) -> str:
        """Return the first of `name`, `name-2`, `name-3`, … that no run has.

        Parameters
        ----------
        name
            The wanted name.
        """
        table = self._open_table()
        candidate = check_name("run", name)
        count = 1
        while _is_taken(table, candidate):
            count += 1
            candidate = f"{name}-{count}"
        return candidate

    def check_unused(self, name: str) -> None:
        """Raise ConflictError if a run of that name exists.

        Parameters
        ----------
        name
            The wanted name.
        """
        self._check_unused(self._open_table(), name)

    def commit(self, run: Run, model: bytes, values: Iterable[pa.Table]) -> None:
        """Write a run: its model and settings first, then its values in one commit, which shows it.

        Parameters
        ----------
        run
            The record.
        model
            The fitted estimator's bytes, whose digest is `run.model`.
        values
            Chunks with the columns of `arrow_schema.VALUES`, in the order of the pairs.

        Raises
        ------
        ConflictError
            If the name is taken, or taken by another writer meanwhile.
        """
        table = self._open_table()
        self._check_unused(table, run.name)
        table.add_columns(VALUES)
        settings = json.dumps(run.to_json(), indent=1, sort_keys=True).encode()
        identity = digest(settings)
        models = self._models(run.name)
        models.write(f"estimator-{run.model}.safetensors", model)
        models.write(f"settings-{identity}.json", settings)
        claim = (_claim(run.name), int(identity, 16))
        table.append(values, partition={"run": run.name}, claim=claim)

    def find_damage(self) -> list[str]:
        """Read all files of all runs and say which are not as they were written."""
        table = self._open_table()
        found = table.find_damage()
        for name in _names(table):
            try:
                self.model(self._read_record(table, name))
            except DamagedError as error:
                found.append(str(error))
        return found

    def _check_version(self, run: Run) -> Run:
        return check_version(run, dataset=self._dataset, version=self._version)

    def _check_unused(self, table: VersionedTable, name: str) -> None:
        if _is_taken(table, check_name("run", name)):
            raise ConflictError(f"run of {self._dataset}: the name {name!r} is taken; give another")

    def _find(self, table: VersionedTable, name: str) -> Run:
        """Read the record of a run in one state of the table; raises NotFoundError."""
        if not _is_taken(table, check_name("run", name)):
            have = ", ".join(_names(table)) or "none"
            raise NotFoundError(f"run of {self._dataset}: expected one of [{have}], found {name!r}")
        return self._read_record(table, name)

    def _read_record(self, table: VersionedTable, name: str) -> Run:
        number = table.find_claim(_claim(name))
        if number is None:
            raise DamagedError(f"run {name!r}: the log has its values but not its claim")
        identity = f"{number:015x}"
        file = f"settings-{identity}.json"
        models = self._models(name)
        settings = _read_checked(models, file, identity)
        try:
            record = Run.from_json(json.loads(settings))
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise DamagedError(f"{models.uri}/{file}: no record of a run ({error!r})") from None
        misfit = find_misfit(record) or ("" if record.name == name else "run")
        if misfit:
            raise DamagedError(f"{models.uri}/{file}: no record of this run (its {misfit})")
        return record

    def _models(self, name: str) -> Folder:
        return self._folder / "models" / name


def create(dataset: Folder) -> None:
    """Create the empty leverage table of a new dataset.

    Parameters
    ----------
    dataset
        The dataset's folder.
    """
    VersionedTable.create(dataset / "leverage", LEVERAGE, partition=["run"])


def digest(data: bytes) -> str:
    """Return the digest in a run's file names: 60 bits of SHA-256, which fit a claim's number.

    Parameters
    ----------
    data
        The file's bytes.
    """
    return hashlib.sha256(data).hexdigest()[:15]


def _names(table: VersionedTable) -> list[str]:
    """List the runs in one state of the table, sorted."""
    return sorted({_run_of(file) for file in table.files()})


def _run_of(file: DataFile) -> str:
    """Return the name of the run that a file has values of, which becomes a folder's name."""
    name = file.partition.get("run")
    try:
        return check_name("run", str(name))
    except InvalidInputError as error:
        raise DamagedError(f"{file.path}: values of no run ({error})") from None


def _claim(name: str) -> str:
    return f"run:{name}"


def _is_taken(table: VersionedTable, name: str) -> bool:
    """Tell whether a commit in this state of the table claims the name of a run."""
    return table.find_claim(_claim(name)) is not None


def _read_checked(folder: Folder, name: str, expected: str) -> bytes:
    """Read a file and compare its digest; raises DamagedError."""
    try:
        data = folder.read(name)
    except NotFoundError as error:
        raise DamagedError(str(error)) from None
    if digest(data) != expected:
        raise DamagedError(f"{folder.uri}/{name}: expected {expected}, found {digest(data)}")
    return data
