"""Worker processes for tasks that may crash or take too much memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any

from ssil_service.workers.worker import EnterPhase, Report, TaskError, Worker, ignore

AssignWorker = Callable[[Worker | None], None]
"""Called with a worker when it begins a task, and with None when it is released."""


@dataclass
class Pool:
    """Worker processes for tasks that may crash or take too much memory.

    There are as many as tasks run at once: who calls `run` bounds that.

    Parameters
    ----------
    lock
        The server's lock (`ServerLease.lock`).
    memory_limit
        Most bytes of memory of one process.
    seconds
        Time after which a task is killed.
    keep
        Most idle workers that are kept for the next task, which saves starting one.
    start_worker
        Starts a process, from `lock` and `memory_limit`.
    """

    lock: Path
    memory_limit: int
    seconds: float
    keep: int = 0
    start_worker: Callable[[Path, int], Worker] = Worker

    def __post_init__(self) -> None:
        """Begin without a worker."""
        self._idle: list[Worker] = []
        self._busy: set[Worker] = set()
        self._guard = Lock()
        self._closed = False

    @property
    def idle_count(self) -> int:
        """Workers that wait for a task."""
        return len(self._idle)

    def run(
        self,
        task: str,
        arguments: dict[str, Any],
        *,
        report: Report = ignore,
        enter_phase: EnterPhase = ignore,
        assign_worker: AssignWorker = ignore,
    ) -> Any:
        """Run a task in a worker and wait for its end.

        Parameters
        ----------
        task, arguments, report, enter_phase
            See `Worker.run`.
        assign_worker
            `assign_worker(worker)` is called when a worker begins, `assign_worker(None)` when it
            is released. In between the worker may be killed to stop the task.

        Returns
        -------
        Any
            The task's result.

        Raises
        ------
        SsilDataError, Problem
            If the request was wrong.
        TaskError
            If the task failed otherwise, no process could be started, or the pool is closed.
        """
        worker = self._take_worker()
        try:
            assign_worker(worker)
            return worker.run(
                task, arguments, seconds=self.seconds, report=report, enter_phase=enter_phase
            )
        finally:
            assign_worker(None)
            self._release(worker)

    def _take_worker(self) -> Worker:
        """Return an idle worker, or start one."""
        with self._guard:
            if self._closed:
                raise TaskError("ShutdownError", "the service is shutting down")
            worker = self._idle.pop() if self._idle else self._start_worker()
            self._busy.add(worker)
        return worker

    def _start_worker(self) -> Worker:
        try:
            return self.start_worker(self.lock, self.memory_limit)
        except OSError as error:  # too many processes, or too little memory
            detail = f"no process could be started ({type(error).__name__})"
            raise TaskError("StartError", detail) from None

    def _release(self, worker: Worker) -> None:
        """Keep a worker for the next task if it lives and there is room for it, else end it."""
        with self._guard:
            self._busy.discard(worker)
            keep = worker.alive and len(self._idle) < self.keep and not self._closed
            if keep:
                self._idle.append(worker)
        if not keep:
            worker.kill()

    def close(self) -> None:
        """End all workers; what they have written by now is still read."""
        with self._guard:
            self._closed = True
            for worker in self._busy:
                worker.kill_soon()
            idle = list(self._idle)
            self._idle.clear()
        for worker in idle:
            worker.kill()
