"""How long does scoring take beside reading, writing and the bare forward pass?

For each estimator, fitted already: `rescore` of the whole racetrack set (read, validate, estimate,
scale, choose alpha, write checksummed Parquet, sync to disk, commit) against its floor: reading and
writing the same rows with pyarrow alone, plus the bare forward pass over arrays in memory. Medians
of interleaved rounds; ratios are to the floor.
"""

from __future__ import annotations

import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from ssil_data.demonstrations import Pairs
from ssil_data.estimators import ESTIMATORS, Fitted
from ssil_data.scoring import rescore, score
from ssil_data.store import Store
from ssil_data.store.arrow_schema import VALUES
from ssil_data.store.dataset import Dataset

ROUNDS = 7


def seconds(work: Callable[[], object]) -> float:
    """Return how long one call takes."""
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def read_and_write(dataset: Dataset, values: pa.Table, folder: Path) -> None:
    """Read the pairs and write a run's values with pyarrow alone: no check, no sync, no log."""
    for path in (Path(dataset.folder.uri) / "pairs").glob("*.parquet"):
        pq.read_table(path, columns=["episode", "step", "state", "action"])
    pq.write_table(values, folder / "values.parquet", compression="zstd", use_dictionary=False)


def main() -> None:
    """Print one row per estimator."""
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "datasets"
        shutil.copytree(Path(__file__).parents[1] / "datasets", store)
        dataset = Store(store)["racetrack"]
        pairs = dataset.pairs()
        print(f"{len(pairs):,} pairs, medians of {ROUNDS} interleaved rounds, milliseconds")
        header = ("fitted", "rescore", "read+write", "forward", "rescore / floor")
        print(f"{header[0]:>10}{header[1]:>10}{header[2]:>12}{header[3]:>10}{header[4]:>17}")
        for kind, estimator in ESTIMATORS.items():
            run = score(dataset, estimator(), run=f"{kind}-fit").name
            print_row(kind, dataset, run, pairs, Path(folder))


def print_row(kind: str, dataset: Dataset, run: str, pairs: Pairs, folder: Path) -> None:
    """Measure one estimator and print its row."""
    fitted: Fitted = dataset.model(run).estimator
    values = dataset.runs.values(run).cast(VALUES)
    whole = []
    files = []
    forward = []
    for _ in range(ROUNDS):
        files.append(seconds(lambda: read_and_write(dataset, values, folder)))
        forward.append(seconds(lambda: fitted.uncertainty(pairs)))
        whole.append(seconds(lambda: rescore(dataset, dataset, run)))
    a, b, c = (1000 * statistics.median(times) for times in (whole, files, forward))
    print(f"{kind:>10}{a:>10.0f}{b:>12.0f}{c:>10.0f}{a / (b + c):>17.2f}")


if __name__ == "__main__":
    main()
