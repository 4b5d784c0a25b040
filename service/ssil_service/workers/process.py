"""The worker process: one task after another, each a line of JSON; it ends with its server.

Started as `python -m ssil_service.workers.process LOCK BYTES`. Requests arrive on standard input,
answers leave on standard output, one JSON object a line; nothing is pickled. When standard input
closes, the server is gone and the process ends at once; a commit to the store is atomic, so
nothing half written is left.

Requests: `{"task": name, "arguments": {…}}`. Answers: any number of `{"progress": {…}}` and
`{"phase": name}`, then one `{"result": …}` or `{"error": {"kind": …, "detail": …}}`.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any, BinaryIO

if TYPE_CHECKING:
    from ssil_service.workers.tasks import Phase


def main(lock: str, memory_limit: str) -> None:
    """Run tasks until standard input closes.

    Parameters
    ----------
    lock
        Path of the server's lock.
    memory_limit
        Most bytes of memory that the process may take.
    """
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what a library prints goes to the log, not between the answers
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    _hold_lock(lock)
    _limit_memory(int(memory_limit))
    requests: SimpleQueue[dict[str, Any]] = SimpleQueue()
    Thread(target=_read_requests, args=(requests,), daemon=True).start()
    while True:
        _run_task(requests.get(), answers)


def _read_requests(requests: SimpleQueue[dict[str, Any]]) -> None:
    """Queue requests as they arrive; the end of standard input ends the process."""
    for line in sys.stdin.buffer:
        requests.put(json.loads(line))
    os._exit(0)


class _Reporter:
    """Writes what a task reports, see `ssil_service.workers.tasks.Reporter`."""

    def __init__(self, answers: BinaryIO) -> None:
        self._answers = answers

    def __call__(self, what: str, done: int, of: int) -> None:
        self.write(progress={"what": what, "done": done, "of": of})

    def enter(self, phase: Phase) -> None:
        self.write(phase=phase)

    def write(self, **message: Any) -> None:
        self._answers.write(json.dumps(message).encode() + b"\n")


def _run_task(request: dict[str, Any], answers: BinaryIO) -> None:
    """Run one task and write its result or its error; nothing that a task raises ends this."""
    from ssil_data.errors import SsilDataError
    from ssil_service.problems import Problem
    from ssil_service.workers.tasks import TASKS

    reporter = _Reporter(answers)
    try:
        result = TASKS[request["task"]](report=reporter, **request["arguments"])
    except Problem as error:
        reporter.write(error={"kind": "Problem", "detail": error.detail, "status": error.status})
    except (SsilDataError, MemoryError, RecursionError) as error:
        detail = str(error) or "the task ran out of memory"
        reporter.write(error={"kind": type(error).__name__, "detail": detail})
    except Exception as error:
        import traceback

        traceback.print_exc()
        detail = f"the task failed ({type(error).__name__})"
        reporter.write(error={"kind": "InternalError", "detail": detail})
    else:
        reporter.write(result=result)


def _hold_lock(lock: str) -> None:
    """Hold the server's lock too, so that its jobs are not adopted while a worker runs.

    If the lock file is gone or replaced, the server is dead: the process ends.
    """
    import fcntl

    try:
        handle = os.open(lock, os.O_RDONLY)
        fcntl.flock(handle, fcntl.LOCK_SH)
        is_current = Path(lock).stat().st_ino == os.fstat(handle).st_ino
    except FileNotFoundError:
        is_current = False
    if not is_current:
        os._exit(0)


def _limit_memory(memory_limit: int) -> None:
    """Bound the process's data segment, and write no core file when it crashes."""
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limit = memory_limit if hard == resource.RLIM_INFINITY else min(memory_limit, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    main(*sys.argv[1:])
