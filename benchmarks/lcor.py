"""How fast and how exact is LCoR, beside the machine's floor and beside other libraries?

Medians of interleaved rounds, nanoseconds of processor time (what one thread takes on a machine of
its own) per pair of a query and a demonstration state. The floor is one maximum and one addition
per dimension with everything in registers. Peers use one thread and answer 64 queries at a time.
Two threads are compared with one by the clock on the wall. States are standard normal, leverages
uniform. Stores of a million and more also answer within a tolerance: `parts/large_store.py`.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping

import llvmlite.binding as llvm
import numpy as np
from parts.large_store import print_large_store
from rivals.floor import Floor
from rivals.peers import find_peers, torch_cdist

from ssil_data.field import auto_alpha
from ssil_data.kernels import Moments, References, cor, log_kernel
from ssil_data.kernels.native import Target

STORE = 49_200
MILLION = 1_000_000
ROUNDS = 7
ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
}
FRESH = """
import sys, time, tracemalloc, numpy as np
from ssil_data.kernels import References
count = int(sys.argv[1])
alpha = float(sys.argv[2])
batch = int(sys.argv[3])
states = np.random.default_rng(0).standard_normal((count, 29), np.float32)
references = References(states, states[:, 0])
begin = time.perf_counter()
references.sums(states[:1], alpha=alpha)
elapsed = time.perf_counter() - begin
tracemalloc.start()
references.sums(states[:batch], alpha=alpha)
print(elapsed, tracemalloc.get_traced_memory()[1] / 2**20)
"""


def draw_states(count: int, width: int, seed: int = 0) -> np.ndarray:
    """Return standard normal states (count, width)."""
    return np.random.default_rng(seed).standard_normal((count, width), np.float32)


def time_in_turns(
    works: Mapping[str, Callable[[], object]],
    rounds: int = ROUNDS,
    clock: Callable[[], float] = time.process_time,
) -> dict[str, float]:
    """Return the median seconds of each; they run in turns.

    The first round compiles and warms up, and is not counted.
    """
    times: dict[str, list[float]] = {name: [] for name in works}
    for count in range(rounds + 1):
        for name, work in works.items():
            begin = clock()
            work()
            if count:
                times[name].append(clock() - begin)
    return {name: statistics.median(values) for name, values in times.items()}


def print_peers(floor: Floor) -> None:
    """Print the engine beside each peer, for 49,200 states of 29 dimensions."""
    states = draw_states(STORE, 29)
    queries = draw_states(2048, 29, 1)
    leverage = np.random.default_rng(2).random(STORE, np.float32)
    references = References(states, leverage)
    few = queries[:64]
    print(f"\n{STORE:,} states, d = 29, 2,048 queries (peers: 64); ns per pair, times as long")
    print(f"{'':>20}" + "".join(f"{name:>18}" for name in ("α = 1", "α = 3", "α auto")))
    rows: dict[str, list[str]] = {}
    for alpha in (1.0, 3.0, auto_alpha(states)):
        works: dict[str, Callable[[], object]] = {
            "engine": lambda alpha=alpha: references.sums(queries, alpha=alpha, threads=1),
            "floor": lambda: floor(STORE * 64, 29),
        }
        works |= {
            name: lambda peer=peer, alpha=alpha: peer(few, states, leverage, alpha)
            for name, peer in find_peers().items()
        }
        each = {
            name: seconds * 1e9 / STORE / (2048 if name == "engine" else 64)
            for name, seconds in time_in_turns(works).items()
        }
        for name, value in each.items():
            ratio = value / each["engine"]
            rows.setdefault(name, []).append(f"{value:>9.2f}{ratio:>8.2f}×")
    for name, cells in rows.items():
        print(f"{name:>20}" + "".join(cells))


def print_powers() -> None:
    """Print the engine's time at several α, whose powers are computed in different ways."""
    states = draw_states(STORE, 29)
    queries = draw_states(2048, 29, 1)
    references = References(states, np.random.default_rng(2).random(STORE, np.float32))
    works = {
        f"{alpha:g}": lambda alpha=alpha: references.sums(queries, alpha=alpha, threads=1)
        for alpha in (1.0, 2.0, 3.0, 7.0, 11.0, 99.0, 199.0, 198.0)
    }
    print("\nthe engine at other α; ns per pair")
    for alpha, seconds in time_in_turns(works).items():
        print(f"{alpha:>20}{seconds * 1e9 / STORE / 2048:>9.2f}")


def print_sizes(floor: Floor) -> None:
    """Print the engine's time and error over sizes of store, state and batch."""
    print("\nthe engine: ns per pair; torch.cdist + pow and the floor beside it; error against")
    print("float64; milliseconds on the wall, and how many times as fast with two threads")
    header = ("states", "d", "queries", "α", "ns", "cdist", "floor", "error", "ms", "threads")
    print("".join(f"{name:>11}" for name in header))
    for count in (STORE, MILLION):
        for width in (20, 29):
            states = draw_states(count, width)
            leverage = np.random.default_rng(2).random(count, np.float32)
            references = References(states, leverage)
            for batch in (1, 64, 2048):
                for alpha in (1.0, 3.0, auto_alpha(states)):
                    queries = draw_states(batch, width, 1)
                    print_size(
                        floor, references, states, leverage=leverage, queries=queries, alpha=alpha
                    )


def print_size(
    floor: Floor,
    references: References,
    states: np.ndarray,
    *,
    leverage: np.ndarray,
    queries: np.ndarray,
    alpha: float,
) -> None:
    """Measure and print one size of store, state and batch."""
    few = queries[: max(1, 64 * STORE // len(states))]
    rounds = ROUNDS if len(states) == STORE else 3
    one, two = (lambda n=n: references.sums(queries, alpha=alpha, threads=n) for n in (1, 2))
    works = {
        "engine": one,
        "floor": lambda: floor(len(few) * len(states), states.shape[1]),
        "cdist": lambda: torch_cdist(few, states, leverage, alpha),
    }
    seconds = time_in_turns(works, rounds)
    engine, lowest, peer = (
        seconds[name] * 1e9 / len(states) / len(batch)
        for name, batch in (("engine", queries), ("floor", few), ("cdist", few))
    )
    wall = time_in_turns({"one": one, "two": two}, rounds, time.perf_counter)
    values = references.sums(queries[:8], alpha=alpha).values
    exact = [compute_lcor(query, states, leverage, alpha) for query in queries[:8]]
    error = np.abs(values - exact).max()
    cells = f"{len(states):>11,}{states.shape[1]:>11}{len(queries):>11,}{alpha:>11.3g}"
    cells += f"{engine:>11.2f}{peer / engine:>10.1f}×{engine / lowest:>10.2f}×{error:>11.1e}"
    print(f"{cells}{wall['one'] * 1000:>11.2f}{wall['one'] / wall['two']:>10.2f}×")


def compute_lcor(
    query: np.ndarray, states: np.ndarray, leverage: np.ndarray, alpha: float
) -> float:
    """Return LCoR of one query in float64, by the formula."""
    weights = np.exp(log_kernel(np.abs(states - query.astype(np.float64)).sum(axis=1), alpha))
    return float(weights @ leverage / weights.sum())


def print_fresh_processes() -> None:
    """Print what a first call costs, in time and in memory beyond the packed store."""
    print("\nfirst call in a fresh process, one query; memory that 2,048 over a million take")
    for alpha in (1.0, 50.0):
        first, _ = measure_fresh(STORE, alpha, 1)
        _, memory = measure_fresh(MILLION, alpha, 2048)
        print(f"  α = {alpha:<4g}{first:>8.2f} s{memory:>8.1f} MB")


def measure_fresh(count: int, alpha: float, batch: int) -> tuple[float, float]:
    """Return seconds and megabytes of one call in a process of its own."""
    command = [sys.executable, "-c", FRESH, str(count), str(alpha), str(batch)]
    seconds, megabytes = subprocess.check_output(command, text=True).split()
    return float(seconds), float(megabytes)


def main() -> None:
    """Print every table."""
    if not ONE_THREAD.items() <= os.environ.items():
        # the peers' libraries read these when they are loaded
        os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | ONE_THREAD)
    target = Target.host()
    features = llvm.get_host_cpu_features()
    names = [name for name in ("avx512f", "avx2", "fma", "neon") if features.get(name)]
    print(f"{', '.join(names)}; {os.cpu_count()} processors; {target and target.tile}")
    floor = Floor()
    print_peers(floor)
    print_powers()
    print_sizes(floor)
    print_fresh_processes()
    states = draw_states(STORE, 29)
    expert = Moments.of(states[:10_000])
    negative = Moments.of(states[10_000:])
    queries = draw_states(2048, 29, 1)
    seconds = time_in_turns({"cor": lambda: cor(queries, expert, negative, 1.0)})["cor"]
    print(f"\nCoR in batches of 2,048: {seconds / 2048 * 1e6:.3f} µs a query")
    print_large_store()


if __name__ == "__main__":
    main()
