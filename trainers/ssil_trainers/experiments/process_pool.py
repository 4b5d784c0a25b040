"""Running tasks on every core: single-threaded worker processes, and progress lines."""

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

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


class NamedTask(Protocol):
    """A task that can be sent to another process."""

    @property
    def name(self) -> str:
        """The name in progress lines."""
        ...

    def __call__(self) -> None:
        """Do the task."""
        ...


Report = Callable[[str], None]
"""Takes a progress line."""


def count_processors() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def open_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Start worker processes of one thread each.

    If anything is raised inside the block, Ctrl-C included, the workers are stopped at once.

    Parameters
    ----------
    workers:
        Number of processes. Their tasks must not start more threads themselves.

    Yields
    ------
    ProcessPoolExecutor
        Runs tasks in the workers.
    """
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    executor = ProcessPoolExecutor(workers, context, initializer=_prepare_worker)
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


def run_tasks(
    executor: ProcessPoolExecutor, what: str, tasks: Sequence[NamedTask], report: Report
) -> None:
    """Run all tasks, in any order; the first error ends it.

    Parameters
    ----------
    executor:
        The workers.
    what:
        What a task is called in progress lines.
    tasks:
        The tasks.
    report:
        Called with a progress line after each task.
    """
    start = time.perf_counter()
    futures: dict[Future[None], NamedTask] = {executor.submit(task): task for task in tasks}
    for done, future in enumerate(as_completed(futures), start=1):
        future.result()
        spent = time.perf_counter() - start
        left = _format_duration(spent / done * (len(tasks) - done))
        report(f"{what} {done} of {len(tasks)}, about {left} left: {futures[future].name}")


def _format_duration(seconds: float) -> str:
    """Write a duration in minutes, or in seconds below 90 of them."""
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"


def _prepare_worker() -> None:
    """Leave Ctrl-C to the parent, end when it ends, and keep torch to one thread."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    import torch

    torch.set_num_threads(1)


def _end_with_parent() -> None:
    """End this process as soon as its parent has ended, killed or not."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
