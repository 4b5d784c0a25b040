"""The tasks of worker processes: fit and score, decode Parquet, write an upload.

Each task imports what it needs, so that a body is decoded without waiting for torch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, Protocol

import pyarrow as pa
import pyarrow.parquet as pq

from ssil_data.client.wire import PARQUET, encode
from ssil_data.errors import InvalidInputError
from ssil_service.formats.arrow import read_stream, unreadable
from ssil_service.problems import Problem

Phase = Literal["reading", "writing"]
"""What a task does with a body. It begins with reading, during which nothing is changed and the
body is to blame for a failure; in writing, a change may have been made."""


class Reporter(Protocol):
    """How a task reports to the server."""

    def __call__(self, what: str, done: int, of: int) -> None:
        """Report progress.

        Parameters
        ----------
        what
            The work, for people.
        done, of
            How many steps of how many are done.
        """
        ...

    def enter(self, phase: Phase) -> None:
        """Report that another phase begins.

        Parameters
        ----------
        phase
            What the task does from now on.
        """
        ...


def make_run(
    *,
    store: str,
    dataset: str,
    version: str,
    run: str,
    body: Mapping[str, Any],
    report: Callable[[str, int, int], None],
) -> None:
    """Make a run as the body of a job describes it; the dataset cannot be deleted meanwhile.

    Parameters
    ----------
    store
        Folder or URI of the store.
    dataset, version
        What is scored.
    run
        Name of the new run.
    body
        Either `{"fitted": {"dataset": …, "run": …}}`, a run whose fitted estimator scores, or a
        recipe as `Recipe.to_json` returns it with the `labels` and the `seed` of the fit; jobs that
        a version without pooling accepted have fewer keys.
    report
        Called with the progress.

    Raises
    ------
    SsilDataError
        If it cannot be made as described, or the name is in use.
    """
    from ssil_data.scoring import Recipe, rescore, score
    from ssil_data.store import Store

    opened = Store(store)
    with opened.open_for_writing(dataset) as newest:
        scored = newest.at(version)
        if "fitted" in body:
            fitted = body["fitted"]
            source = opened[fitted["dataset"] or dataset]
            rescore(scored, source, fitted["run"], run=run, progress=report)
        else:
            recipe = Recipe.from_json(body)
            labels = body.get("labels")
            score(scored, recipe, labels=labels, seed=body["seed"], run=run, progress=report)


def decode(*, source: str, target: str, most_rows: int, report: Reporter) -> None:
    """Read a Parquet file and write it as an Arrow stream.

    Parameters
    ----------
    source, target
        Paths of the two files.
    most_rows
        Rows that the file may have.
    report
        Not used: reading is the only phase.

    Raises
    ------
    Problem
        413 for too many rows, 422 for a file that is not readable.
    """
    table = _read_parquet(Path(source), most_rows)
    Path(target).write_bytes(encode(table))


def upload(
    *,
    store: str,
    dataset: str,
    source: str,
    media: str,
    append: bool,
    layout: Mapping[str, Any],
    file: str,
    most_rows: int,
    report: Reporter,
) -> str:
    """Write an uploaded file as a new dataset, or append it to one.

    Parameters
    ----------
    store
        Folder or URI of the store.
    dataset
        Name of the dataset.
    source
        Path of the uploaded file.
    media
        Its media type, Parquet or an Arrow stream.
    append
        Whether the dataset exists and gets more episodes.
    layout
        Which columns hold what, as the request's parameters name them.
    file
        What the episodes name as their source.
    most_rows
        Rows that the file may have.
    report
        Called when the file is read and writing begins.

    Returns
    -------
    str
        The version of the dataset with the upload.

    Raises
    ------
    Problem
        413 for too many rows, 422 for a file that is not readable.
    SsilDataError
        If the store refuses the episodes.
    """
    from ssil_data.store import Store
    from ssil_service.formats.episodes import Upload

    read = _read_parquet if media == PARQUET else _read_arrow
    found = Upload.of(read(Path(source), most_rows), layout=layout, file=file)
    report.enter("writing")
    opened = Store(store)
    if append:
        with opened.open_for_writing(dataset) as old:
            found.check_dimension_names(old)
            return old.append(found.episodes).version
    new = opened.create(
        dataset,
        found.episodes,
        state_names=found.state_names,
        action_names=found.action_names,
        card=found.card or f"# {dataset}\n",
    )
    return new.version


TASKS: Mapping[str, Callable[..., Any]] = {
    "make_run": make_run,
    "decode": decode,
    "upload": upload,
}
"""Tasks by the name that the server sends."""


def _read_arrow(source: Path, most_rows: int) -> pa.Table:
    # the mapping is not closed here: the table's buffers lie in it and keep it open
    body = pa.memory_map(str(source)).read_buffer()
    return read_stream(body, most_rows=most_rows, check=lambda schema: None)


def _read_parquet(source: Path, most_rows: int) -> pa.Table:
    """Read a Parquet file; its footer must not promise more rows than are allowed.

    A footer that lies is caught by the limit of this process's memory.
    """
    try:
        parquet = pq.ParquetFile(source, page_checksum_verification=True)
        if parquet.metadata.num_rows > most_rows:
            raise Problem(
                413,
                f"body: expected at most {most_rows} rows, found {parquet.metadata.num_rows}",
            )
        batches = []
        for batch in parquet.iter_batches(batch_size=16_384, use_threads=False):
            batch.validate(full=True)
            batches.append(batch)
        return pa.Table.from_batches(batches, parquet.schema_arrow)
    except (Problem, InvalidInputError, MemoryError, pa.ArrowMemoryError):
        raise
    except Exception as error:
        raise unreadable("a Parquet file", error) from None
