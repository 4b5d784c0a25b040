"""Is a set larger than memory scored in bounded memory?

The racetrack set, repeated 1, 10 and 40 times, is scored in a fresh process each, by a VAE
alone and by the preset `default`; the peak memory of the process above that of scoring the first
is printed beside the size of the set in memory.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ssil_data.demonstrations import Episode
from ssil_data.estimators import VAE
from ssil_data.scoring import preset, rescore, score
from ssil_data.store import Store
from ssil_data.store.dataset import Dataset
from ssil_data.store.folder import Folder

TIMES = (1, 10, 40)
RECIPES = {"vae": VAE(), "default": preset("default")}


def repeat_episodes(dataset: Dataset, times: int) -> Iterator[Episode]:
    """Yield the episodes of a dataset several times over."""
    pairs = dataset.pairs()
    labeled = dataset.episodes["labeled"].to_pylist()
    stops = np.cumsum(dataset.episodes["length"].to_numpy())
    for _ in range(times):
        for stop, length, known in zip(
            stops, dataset.episodes["length"].to_pylist(), labeled, strict=True
        ):
            rows = slice(stop - length, stop)
            yield Episode(pairs.states[rows], pairs.actions[rows], labeled=known)


def create(store: Store, dataset: Dataset, times: int) -> Dataset:
    """Store a dataset that has the episodes of another several times, as x1, x10, …"""
    return store.create(
        f"x{times}",
        repeat_episodes(dataset, times),
        state_names=dataset.state_names,
        action_names=dataset.action_names,
    )


def main() -> None:
    """Print one row per size."""
    racetrack = Store(Path(__file__).parents[1] / "datasets")["racetrack"]
    width = len(racetrack.state_names) + len(racetrack.action_names)
    with tempfile.TemporaryDirectory() as folder:
        store = Store(folder)
        small = create(store, racetrack, 1)
        for name, recipe in RECIPES.items():
            score(small, recipe, run=name)
        for times in TIMES[1:]:
            create(store, racetrack, times)
        columns = ("run", "pairs", "set, MiB", "peak, MiB", "more, MiB", "bytes/pair")
        print("".join(f"{column:>12}" for column in columns))
        for name in RECIPES:
            least = measure(folder, 1, name)
            for times in TIMES:
                peak = measure(folder, times, name) if times > 1 else least
                count = times * len(racetrack)
                size = count * 4 * width / 2**20
                more = peak - least
                print(
                    f"{name:>12}{count:>12,}{size:>12.0f}{peak:>12.0f}{more:>12.0f}"
                    f"{more * 2**20 / count:>12.1f}",
                    flush=True,
                )


def measure(folder: str, times: int, run: str) -> float:
    """Return the peak memory, MiB, of a process that scores one dataset as a run has the first."""
    command = [sys.executable, __file__, folder, f"x{times}", run]
    return int(subprocess.run(command, capture_output=True, check=True).stdout) / 1024


def measure_peak(folder: str, name: str, run: str) -> None:
    """Score one dataset in this process and print the peak of its memory in KiB.

    Linux keeps `ru_maxrss` over the start of a program, so that it may be the parent's.
    """
    rescore(Dataset(Folder(folder) / name), Dataset(Folder(folder) / "x1"), run)
    status = Path("/proc/self/status").read_text()
    print(re.search(r"VmHWM:\s+(\d+)", status)[1])  # pyright: ignore[reportOptionalSubscript]


if __name__ == "__main__":
    if len(sys.argv) > 1:
        measure_peak(*sys.argv[1:])
    else:
        main()
