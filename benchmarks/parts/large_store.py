"""LCoR over ten million states: how much faster a sample answers, and how often its bounds hold.

Two stores: standard normal states with uniform leverages, and the committed racetrack states, drawn
with replacement and moved by .1 deviations in every dimension, with the leverage that a windowVAE
gave to the state they come from. They lie in a file of their own, mapped into memory. Queries are
such states moved by another .1, every fourth by half as much again away from the mean.
"""

from __future__ import annotations

import resource
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import ssil_data as sd
from ssil_data.features import Standardizer
from ssil_data.field import auto_alpha
from ssil_data.kernels import Estimate, References, Sampled

DATASETS = Path(__file__).parents[2] / "datasets"
CHUNK = 1 << 20
SIZES = (1_000_000, 10_000_000)
QUERIES = 2048
SEEDS = 10
SIZE = 32_768
TOLERANCES = (1e-2, 1e-3)


def score_racetrack(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the racetrack's standardized states and the leverage of a windowVAE."""
    shutil.copytree(DATASETS / "racetrack", folder / "store" / "racetrack")
    dataset = sd.Store(str(folder / "store"))["racetrack"]
    run = sd.score(dataset, sd.WindowVAE(), seed=0)
    states = dataset.pairs().states
    return Standardizer.of(states)(states), dataset.leverage(run.name)


def write_store(path: Path, kind: str, count: int, known: tuple[np.ndarray, np.ndarray]) -> tuple:
    """Write `count` states to a file, chunk by chunk; return them mapped, and their leverage."""
    states, leverage = known
    width = states.shape[1]
    rng = np.random.default_rng(0)
    file = np.lib.format.open_memmap(path, "w+", np.float32, (count, width))
    levels = np.empty(count, np.float32)
    for first in range(0, count, CHUNK):
        rows = slice(first, min(first + CHUNK, count))
        size = rows.stop - first
        noise = rng.standard_normal((size, width), np.float32)
        if kind == "normal":
            file[rows] = noise
            levels[rows] = rng.random(size, np.float32)
        else:
            drawn = rng.integers(len(states), size=size)
            file[rows] = states[drawn] + np.float32(0.1) * noise
            levels[rows] = leverage[drawn]
    file.flush()
    return np.load(path, mmap_mode="r"), levels


def draw_queries_near(states: np.ndarray) -> np.ndarray:
    """Return queries near some of the states, every fourth farther out."""
    rng = np.random.default_rng(1)
    rows = np.sort(rng.integers(len(states), size=QUERIES))
    queries = states[rows] + np.float32(0.1) * rng.standard_normal((QUERIES, states.shape[1]))
    queries[::4] *= 1.5
    return rng.permutation(queries).astype(np.float32)


def print_store(
    name: str,
    states: np.ndarray,
    leverage: np.ndarray,
    alphas: tuple[float, ...],
) -> None:
    """Print the rows of one store: a sample of 32,768, then two tolerances, beside all states."""
    queries = draw_queries_near(states)
    begin = time.perf_counter()
    references = References(states, leverage)
    packed = time.perf_counter() - begin
    source = Sampled(states, leverage, lambda: references)
    source.prepare()
    print(f"{name}: packed in {packed:.1f} s, tables in", end=" ")
    print(f"{time.perf_counter() - begin - packed:.1f} s; {describe_memory()}")
    for alpha in alphas:
        begin = time.process_time()
        truth = references.sums(queries, alpha=alpha, threads=1).values
        exact = time.process_time() - begin
        source.estimate_of_size(queries[:1], alpha=alpha, size=SIZE)  # draws and packs the sample
        works: dict[str, Callable[[int], Estimate]] = {
            f"{SIZE:,} states": lambda seed, a=alpha: source.estimate_of_size(
                queries, alpha=a, size=SIZE, seed=seed, threads=1
            ),
            **{
                f"within {tolerance:g}": lambda seed, a=alpha, t=tolerance: source.estimate_within(
                    queries, alpha=a, tolerance=t, seed=seed, threads=1
                )
                for tolerance in TOLERANCES
            },
        }
        for what, work in works.items():
            print_row((name, alpha, what), work, exact=exact, truth=truth)


def print_row(
    names: tuple[str, float, str],
    work: Callable[[int], Estimate],
    *,
    exact: float,
    truth: np.ndarray,
) -> None:
    """Print one row: time over all queries, half-widths, coverage over several seeds.

    `names` are those of the store, α and the work; `exact` is the seconds that exact sums take, and
    `truth` their LCoR.
    """
    name, alpha, what = names
    seconds = []
    answers = []
    for seed in range(SEEDS):
        work(seed)  # draws and packs the sample of this seed
        begin = time.process_time()
        answers.append(work(seed))
        seconds.append(time.process_time() - begin)
        if seconds[-1] > 0.2 * exact:
            break  # no gain, so one seed is enough
    cost = statistics.median(seconds)
    error = np.stack([np.abs(answer.values - truth) for answer in answers])
    widths = np.stack([answer.half_width for answer in answers])
    sampled = widths > 0
    covered = (error <= widths)[sampled].mean() if sampled.any() else np.nan
    cells = (
        f"{name:>22}{alpha:>8.3g}{what:>16}{cost * 1e3:>9.0f}{exact / cost:>9.1f}×"
        f"{np.median(widths[sampled]) if sampled.any() else 0:>10.1e}"
        f"{np.median(error):>10.1e}{covered:>9.4f}{sampled.sum():>8,}{1 - sampled.mean():>9.1%}"
    )
    print(cells, flush=True)


def describe_memory() -> str:
    """Return this process's memory: its own, and that of mapped files."""
    status = Path("/proc/self/status")
    if not status.exists():
        return f"peak {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.1f} GiB"
    lines = (line.split() for line in status.read_text().splitlines())
    sizes = {line[0]: int(line[1]) / 2**20 for line in lines if line[0] in ("RssAnon:", "VmHWM:")}
    return f"memory {sizes['RssAnon:']:.1f} GiB, peak with mapped files {sizes['VmHWM:']:.1f} GiB"


def print_large_store() -> None:
    """Print the table."""
    print(
        f"\n{QUERIES:,} queries, d = 29, one thread, ms of processor time for all, times as fast as"
    )
    print(f"exact sums; median half-width and error; coverage over {QUERIES:,} × {SEEDS} answers")
    print("(of the sampled ones, how many); queries answered exactly")
    header = (("store", 22), ("α", 8), ("asked", 16), ("ms", 9), ("faster", 10), ("width", 10))
    header += (("error", 10), ("cover", 9), ("of", 8), ("exactly", 9))
    print("".join(f"{name:>{width}}" for name, width in header))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        known = score_racetrack(folder)
        for count in SIZES:
            for kind in ("racetrack", "normal"):
                path = folder / "states.npy"
                states, leverage = write_store(path, kind, count, known)
                sharp = auto_alpha(np.array(states[:: count // 20_000]))
                print_store(f"{kind} {count:,}", states, leverage, (1.0, 3.0, sharp))
                path.unlink()
