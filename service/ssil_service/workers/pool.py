"""Worker processes as seen by the server: started, asked, timed, killed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock, Timer
from typing import Any

from ssil_data.errors import ConflictError, InvalidInputError, NotFoundError, SsilDataError
from ssil_service.problems import Problem

Report = Callable[[dict[str, Any]], None]
_KINDS: dict[str, type[SsilDataError]] = {
    "ConflictError": ConflictError,
    "InvalidInputError": InvalidInputError,
    "NotFoundError": NotFoundError,
}


class TaskError(Exception):
    """A task that failed by no fault of the request's form: it crashed, or ran out of memory."""

    def __init__(self, kind: str, detail: str) -> None:
        super().__init__(detail)
        self.kind = kind
        self.detail = detail


class Worker:
    """One process; it holds the server's lock and may take `most_bytes` of memory."""

    def __init__(self, lock: Path, most_bytes: int) -> None:
        command = [sys.executable, "-m", "ssil_service.workers.process", str(lock), str(most_bytes)]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=_without_keys(os.environ),
            start_new_session=True,
        )
        self._killed = self._late = False

    def run(self, task: str, arguments: dict[str, Any], report: Report, seconds: float) -> Any:
        """Return a task's result; raises the library's error, a Problem or TaskError."""
        watch = Timer(seconds, self._too_late)
        watch.daemon = True
        watch.start()
        try:
            return self._answer({"task": task, "arguments": arguments}, report)
        finally:
            watch.cancel()
            watch.join()  # afterwards it is known whether the process was killed

    def _answer(self, order: dict[str, Any], report: Report) -> Any:
        self._send(json.dumps(order).encode() + b"\n")
        while message := self._listen():
            if "progress" in message:
                report(message["progress"])
            elif "error" in message:
                raise _error(message["error"])
            else:
                return message["result"]
        raise self._describe_death()

    def _send(self, line: bytes) -> None:
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):  # killed before it began: nothing will be heard of it
            self._process.stdin.write(line)
            self._process.stdin.flush()

    def _listen(self) -> dict[str, Any]:
        """Return what the process says next; nothing if it ended, even within a line."""
        assert self._process.stdout is not None
        try:
            message = json.loads(self._process.stdout.readline())
        except (OSError, ValueError, RecursionError):
            return {}
        known = isinstance(message, dict) and {"progress", "error", "result"} & message.keys()
        return message if known else {}

    def _describe_death(self) -> TaskError:
        self.kill()
        if self._late:
            return TaskError("TimeoutError", "the task took longer than it may")
        return TaskError("CrashError", f"the process ended with status {self._process.returncode}")

    def _too_late(self) -> None:
        self._late = True
        self.kill_soon()

    def kill_soon(self) -> None:
        """End the process; whoever waits for its answer cleans up."""
        self._killed = True
        self._process.kill()

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with suppress(BrokenPipeError):
                pipe.close()

    @property
    def alive(self) -> bool:
        """Tell whether the process still runs, and was not told to end."""
        return not self._killed and self._process.poll() is None


Started = Callable[[Worker | None], None]


def _without_keys(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the environment of a process that needs no keys; names in either case are settings."""
    secret = ("SSIL_READ_KEY", "SSIL_WRITE_KEY")
    return {name: value for name, value in environment.items() if name.upper() not in secret}


def _error(error: dict[str, Any]) -> Exception:
    if error["kind"] == "Problem":
        return Problem(error["status"], error["detail"])
    if error["kind"] in _KINDS:
        return _KINDS[error["kind"]](error["detail"])
    return TaskError(error["kind"], error["detail"])


@dataclass
class Pool:
    """Workers for tasks that may crash; up to `keep` are kept warm between tasks."""

    lock: Path
    most_bytes: int
    seconds: float
    keep: int = 0

    def __post_init__(self) -> None:
        """Begin without a worker."""
        self._idle: list[Worker] = []
        self._busy: set[Worker] = set()
        self._guard = Lock()
        self._closed = False

    def run(
        self,
        task: str,
        arguments: dict[str, Any],
        *,
        report: Report = lambda progress: None,
        started: Started = lambda worker: None,
    ) -> Any:
        """Run a task in a worker; `started` is told which may be killed, None before it is idle."""
        with self._guard:
            if self._closed:
                raise TaskError("ShutdownError", "the service is shutting down")
            worker = self._idle.pop() if self._idle else self._new()
            self._busy.add(worker)
        try:
            started(worker)
            return worker.run(task, arguments, report, self.seconds)
        finally:
            started(None)
            with self._guard:
                self._busy.discard(worker)
                kept = worker.alive and len(self._idle) < self.keep and not self._closed
                if kept:
                    self._idle.append(worker)
            if not kept:
                worker.kill()

    def _new(self) -> Worker:
        try:
            return Worker(self.lock, self.most_bytes)
        except OSError as error:  # too many processes, or too little memory
            detail = f"no process could be started ({type(error).__name__})"
            raise TaskError("StartError", detail) from None

    def close(self) -> None:
        """End all workers."""
        with self._guard:
            self._closed = True
            for worker in self._busy:
                worker.kill_soon()  # what it has said by now is still heard
            idle = [self._idle.pop() for _ in list(self._idle)]
        for worker in idle:
            worker.kill()
