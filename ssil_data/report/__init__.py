"""The report: one offline page about all runs of a version of a dataset."""

from __future__ import annotations

from pathlib import Path

from ssil_data.errors import InvalidInputError
from ssil_data.report.evidence import Evidence
from ssil_data.report.page import build_page
from ssil_data.scoring import Progress
from ssil_data.store.dataset import Dataset
from ssil_data.store.folder import Folder

__all__ = ["write_report"]


def write_report(dataset: Dataset, output: Path, *, progress: Progress | None = None) -> None:
    """Write one offline HTML page about all runs of a dataset: which demonstrations to trust.

    The file is written whole or not at all. The same store gives the same bytes.

    Parameters
    ----------
    dataset
        With at least one run of its current version.
    output
        File to write; an older one is replaced.
    progress
        Called with what is being done, how many steps of it are done, and of how many.

    Raises
    ------
    InvalidInputError
        If the dataset has no run, the folder of `output` does not exist, or `output` is a folder.

    Examples
    --------
    >>> from pathlib import Path
    >>> sd.write_report(dataset, Path("report.html"))
    >>> Path("report.html").read_text().startswith("<!doctype html>")
    True
    """
    folder = output.absolute().parent
    if not folder.is_dir():
        raise InvalidInputError(f"output: the folder {folder} does not exist")
    if output.is_dir():
        raise InvalidInputError(f"output: {output} is a folder; name a file")
    html = build_page(Evidence.of(dataset, progress or _silent), progress or _silent)
    Folder(folder).write(output.name, html.encode())


def _silent(what: str, done: int, of: int) -> None:
    """Show no progress."""
