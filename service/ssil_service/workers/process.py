"""A process that does one task at a time, told by lines of JSON; it ends with its server.

Started as `python -m ssil_service.worker LOCK BYTES`. What it is told arrives on standard input,
what it answers leaves on standard output; nothing is pickled. When standard input closes, the
server is gone, and the process ends at once: the store's commits are atomic.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any, BinaryIO


def main(lock: str, most_bytes: str) -> None:
    """Serve tasks until standard input closes."""
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # whatever a library prints is no answer
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    _hold(lock)
    _limit_memory(int(most_bytes))
    orders: SimpleQueue[dict[str, Any]] = SimpleQueue()
    Thread(target=_listen, args=(orders,), daemon=True).start()
    while True:
        _do(orders.get(), answers)


def _listen(orders: SimpleQueue[dict[str, Any]]) -> None:
    for line in sys.stdin.buffer:
        orders.put(json.loads(line))
    os._exit(0)


def _do(order: dict[str, Any], answers: BinaryIO) -> None:
    from ssil_data.errors import SsilDataError
    from ssil_service.problems import Problem
    from ssil_service.workers import tasks

    def tell(**message: Any) -> None:
        answers.write(json.dumps(message).encode() + b"\n")

    def report(what: str, done: int, of: int) -> None:
        tell(progress={"what": what, "done": done, "of": of})

    try:
        result = tasks.TASKS[order["task"]](report=report, **order["arguments"])
    except Problem as error:
        tell(error={"kind": "Problem", "detail": error.detail, "status": error.status})
    except (SsilDataError, MemoryError, RecursionError) as error:
        detail = str(error) or "expected enough memory, found too little"
        tell(error={"kind": type(error).__name__, "detail": detail})
    except Exception as error:
        import traceback

        traceback.print_exc()
        tell(error={"kind": "InternalError", "detail": f"the task failed ({type(error).__name__})"})
    else:
        tell(result=result)


def _hold(lock: str) -> None:
    """Hold the server's lock as well: while it is held, nobody takes over the server's jobs."""
    import fcntl

    try:
        handle = os.open(lock, os.O_RDONLY)
        fcntl.flock(handle, fcntl.LOCK_SH)
        alive = Path(lock).stat().st_ino == os.fstat(handle).st_ino
    except FileNotFoundError:
        alive = False
    if not alive:
        os._exit(0)


def _limit_memory(most: int) -> None:
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limit = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    main(*sys.argv[1:])
