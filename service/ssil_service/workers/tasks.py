"""What worker processes do: fit and score, decode Parquet, write what was uploaded.

Each task imports what it needs: a body is decoded without waiting for torch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ssil_data.client.wire import PARQUET, encode
from ssil_data.errors import InvalidInputError
from ssil_service.formats.arrow import not_readable, read_stream
from ssil_service.problems import Problem

Progress = Callable[[str, int, int], None]


def make_run(
    *, store: str, dataset: str, version: str, run: str, body: Mapping[str, Any], report: Progress
) -> None:
    """Make a run as the body of a job describes it; the dataset is not deleted meanwhile."""
    from ssil_data import scales
    from ssil_data.estimators import from_json
    from ssil_data.scoring import rescore, score
    from ssil_data.store import Store

    place = Store(store)
    with place.open_for_writing(dataset) as newest:
        scored = newest.at(version)
        if "fitted" in body:
            fitted = body["fitted"]
            source = place[fitted["dataset"] or dataset]
            rescore(scored, source, fitted["run"], run=run, progress=report)
        else:
            score(
                scored,
                from_json(body["estimator"]),
                scale=scales.settings_from_json(body["scale"]),
                labeled_is_one=body["labeled_is_one"],
                seed=body["seed"],
                run=run,
                progress=report,
            )


def decode(*, source: str, target: str, most_rows: int, report: Progress) -> None:
    """Read a Parquet file and write it as an Arrow stream."""
    table = _parquet(Path(source), most_rows)
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
    report: Progress,
) -> str:
    """Write an uploaded file as a new dataset, or a new version of one; return the version."""
    from ssil_data.store import Store
    from ssil_service.formats.episodes import Upload

    report("read", 0, 1)
    read = _parquet if media == PARQUET else _arrow
    found = Upload.of(read(Path(source), most_rows), layout=layout, file=file)
    report("read", 1, 1)
    place = Store(store)
    if append:
        with place.open_for_writing(dataset) as old:
            found.refuse_other_names(old.state_names, old.action_names)
            return old.append(found.episodes).version
    new = place.create(
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


def _arrow(source: Path, most_rows: int) -> pa.Table:
    # not closed here: the table's buffers lie in the mapping, which goes when they do
    body = pa.memory_map(str(source)).read_buffer()
    return read_stream(body, most_rows=most_rows, check=lambda schema: None)


def _parquet(source: Path, most_rows: int) -> pa.Table:
    """Read a Parquet file whose footer promises no more than it may hold.

    The footer may lie: what it hides is stopped by this process's limit of memory.
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
        raise not_readable("a Parquet file", error) from None
