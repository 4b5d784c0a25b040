"""The report: one offline page about all runs of a version of a dataset."""

from __future__ import annotations

from pathlib import Path

from ssil_data.errors import InvalidInputError
from ssil_data.report.evidence import Evidence
from ssil_data.report.page import page
from ssil_data.scoring import Progress
from ssil_data.store.dataset import Dataset
from ssil_data.store.folder import Folder

__all__ = ["write_report"]


def write_report(dataset: Dataset, output: Path, *, progress: Progress | None = None) -> None:
    """Write the report of a dataset's runs to the file `output`, whole or not at all.

    Same store, same bytes. Raises InvalidInputError if the dataset has no run or the folder of
    `output` does not exist.
    """
    folder = output.absolute().parent
    if not folder.is_dir():
        raise InvalidInputError(f"output: expected an existing folder, found {folder}")
    if output.is_dir():
        raise InvalidInputError(f"output: expected a file, found the folder {output}")
    html = page(Evidence.of(dataset, progress or _silent), progress or _silent)
    Folder(folder).write(output.name, html.encode())


def _silent(what: str, done: int, of: int) -> None:
    """Report to nobody."""
