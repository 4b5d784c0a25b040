"""A worker process as the server sees it: a task in, its progress and its result out."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Timer
from typing import Any

from ssil_data.client.error_kinds import caller_error
from ssil_service.problems import Problem
from ssil_service.workers.tasks import Phase

Report = Callable[[dict[str, Any]], None]
"""Called with the progress of a task: `what` it does, `done` steps, `of` steps."""
EnterPhase = Callable[[Phase], None]
"""Called when a task enters a phase, see `Phase`."""
_SECRETS = ("SSIL_READ_KEY", "SSIL_WRITE_KEY")
_MESSAGES = {"progress", "phase", "error", "result"}
"""Keys of the lines that a worker writes, one of them in each."""


def ignore(_: Any) -> None:
    """Do nothing with what is reported."""


class TaskError(Exception):
    """A task failed, and not because its request was wrong: it crashed, or ran out of memory.

    Parameters
    ----------
    kind
        What happened: `CrashError`, `TimeoutError`, `MemoryError`, `StartError`, `ShutdownError`,
        or the name of an exception that the task raised.
    detail
        A sentence for people.
    """

    def __init__(self, kind: str, detail: str) -> None:
        super().__init__(detail)
        self.kind = kind
        self.detail = detail


class Worker:
    """One worker process; it ends when it is killed, and when the server ends.

    Parameters
    ----------
    lock
        The server's lock (`ServerLease.lock`), which the worker holds as well.
    memory_limit
        Most bytes of memory that the process may take.

    Raises
    ------
    OSError
        If no process can be started.
    """

    def __init__(self, lock: Path, memory_limit: int) -> None:
        module = "ssil_service.workers.process"
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, str(lock), str(memory_limit)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=_without_keys(os.environ),
            start_new_session=True,
        )
        self._killed = False
        self._timed_out = False

    def run(
        self,
        task: str,
        arguments: dict[str, Any],
        *,
        seconds: float,
        report: Report = ignore,
        enter_phase: EnterPhase = ignore,
    ) -> Any:
        """Run a task and wait for its end.

        Parameters
        ----------
        task
            A key of `ssil_service.workers.tasks.TASKS`.
        arguments
            Keyword arguments of the task, as JSON.
        seconds
            Time after which the process is killed.
        report, enter_phase
            Called with what the task reports meanwhile.

        Returns
        -------
        Any
            The task's result, from JSON.

        Raises
        ------
        SsilDataError, Problem
            If the task raised it: the request was wrong.
        TaskError
            If the task failed otherwise.
        """
        timer = Timer(seconds, self._time_out)
        timer.daemon = True
        timer.start()
        try:
            self._send({"task": task, "arguments": arguments})
            return self._wait_for_result(report, enter_phase, seconds)
        finally:
            timer.cancel()
            timer.join()  # from now on the timer kills nothing, and `alive` is right

    def _send(self, request: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):  # a dead process is noticed when its answer is read
            self._process.stdin.write(json.dumps(request).encode() + b"\n")
            self._process.stdin.flush()

    def _wait_for_result(self, report: Report, enter_phase: EnterPhase, seconds: float) -> Any:
        while message := self._read_message():
            if "progress" in message:
                report(message["progress"])
            elif "phase" in message:
                enter_phase(message["phase"])
            elif "error" in message:
                raise _exception(message["error"])
            else:
                return message["result"]
        self.kill()
        if self._timed_out:
            raise TaskError("TimeoutError", f"the task took longer than {seconds:g} s")
        status = self._process.returncode
        raise TaskError("CrashError", f"the process ended with status {status}")

    def _read_message(self) -> dict[str, Any]:
        """Return what the process writes next; an empty message if it ended, even in mid-line."""
        assert self._process.stdout is not None
        try:
            message = json.loads(self._process.stdout.readline())
        except (OSError, ValueError, RecursionError):
            return {}
        is_known = isinstance(message, dict) and bool(_MESSAGES & message.keys())
        return message if is_known else {}

    def _time_out(self) -> None:
        self._timed_out = True
        self.kill_soon()

    def kill_soon(self) -> None:
        """Kill the process from any thread; `run` then raises in its own thread and cleans up."""
        self._killed = True
        self._process.kill()

    def kill(self) -> None:
        """Kill the process, wait for its end, and close its pipes."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with suppress(BrokenPipeError):
                pipe.close()

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the process runs and was not killed."""
        return not self._killed and self._process.poll() is None


def _without_keys(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment without the API keys, whose names count in either case."""
    return {name: value for name, value in environment.items() if name.upper() not in _SECRETS}


def _exception(error: dict[str, Any]) -> Exception:
    """Return the exception that a worker describes."""
    kind = error["kind"]
    if kind == "Problem":
        return Problem(error["status"], error["detail"])
    return caller_error(kind, error["detail"]) or TaskError(kind, error["detail"])
