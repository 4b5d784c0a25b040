"""Doing tasks on every core: single-threaded workers, a progress line, a stop that loses little."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Protocol

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class Named(Protocol):
    """Something to do that can be sent to another process."""

    @property
    def name(self) -> str:
        """What a progress line calls it."""
        ...

    def __call__(self) -> None:
        """Do it."""
        ...


Tell = Callable[[str], None]


def processors() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Open so many spawned workers of one thread each; what they do must not ask for more.

    If anything is raised inside, Ctrl-C included, what the workers are doing is broken off.
    """
    before = {name: os.environ.get(name) for name in THREADS}
    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    os.environ.update(dict.fromkeys(THREADS, "1"))
    executor = ProcessPoolExecutor(workers, context, initializer=_begin)
    try:
        yield executor
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        executor.shutdown(cancel_futures=True)
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def do(executor: ProcessPoolExecutor, what: str, tasks: Sequence[Named], tell: Tell) -> None:
    """Do all tasks, in any order, and tell of each; the first error ends it."""
    begin = time.perf_counter()
    futures: dict[Future[None], Named] = {executor.submit(task): task for task in tasks}
    for done, future in enumerate(as_completed(futures), start=1):
        future.result()
        spent = time.perf_counter() - begin
        left = _duration(spent / done * (len(tasks) - done))
        tell(f"{what} {done} of {len(tasks)}, about {left} left: {futures[future].name}")


def _duration(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"


def _begin() -> None:
    """Leave Ctrl-C to the parent, end when it ends, and keep torch to one thread."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    import torch

    torch.set_num_threads(1)


def _end_with_parent() -> None:
    """Wait for a parent that was killed: nobody would take what this worker does."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
