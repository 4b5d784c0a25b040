"""Runs `ssil-data` and `python -` in forks of one process that has imported what they need.

A page of the manual has a dozen commands, and each would import torch first. A shim on the PATH
hands its words, folder, environment and standard streams to that process, which forks and runs the
command's own `main`; the exit status comes back. Servers, which run in the background and are ended
by signals, are started as they are.
"""

from __future__ import annotations

import array
import importlib
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

IMPORTS = (
    "deltalake",
    "gpytorch",
    "scipy.stats",
    "ssil_data.cli",
    "ssil_data.client.store",
    "ssil_data.commands.data",
    "ssil_data.commands.lcor",
    "ssil_data.commands.leverage",
    "ssil_data.commands.show",
    "ssil_data.report",
    "ssil_service.app",
    "torch",
)
SHIM = """#!{python} -IS
import array, json, os, socket, sys
name = os.path.basename(sys.argv[0])
words = sys.argv[1:]
if (name == "python" and words != ["-"]) or words[:1] == ["serve"]:
    os.execv(os.path.join({binaries!r}, name), [name, *words])
order = json.dumps([name, words, os.getcwd(), dict(os.environ)]).encode()
streams = array.array("i", [0, 1, 2])
rights = (socket.SOL_SOCKET, socket.SCM_RIGHTS, streams)
with socket.socket(socket.AF_UNIX) as server:
    server.connect({address!r})
    server.sendmsg([len(order).to_bytes(4, "big")], [rights])
    server.sendall(order)
    sys.exit(int(server.recv(3) or b"70"))
"""


@contextmanager
def preload(folder: Path) -> Iterator[Path]:
    """Give a folder for the PATH whose `ssil-data` and `python` run in forks.

    Parameters
    ----------
    folder
        An empty folder.
    """
    address = str(folder / "socket")
    binaries = str(Path(sys.executable).parent)
    for name in ("ssil-data", "python"):
        shim = folder / name
        shim.write_text(SHIM.format(python=sys.executable, binaries=binaries, address=address))
        shim.chmod(0o755)
    code = "import sys; from support.preloaded import serve; serve(sys.argv[1])"
    paths = {"PYTHONPATH": str(Path(__file__).parents[1])}
    process = subprocess.Popen(
        [sys.executable, "-c", code, address],
        env={**os.environ, **paths},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    try:
        yield folder
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def serve(address: str) -> None:
    """Import, then fork for every order that arrives at the address."""
    for name in IMPORTS:
        importlib.import_module(name)
    rendering = importlib.import_module("ssil_data.report.rendering")
    rendering._bundle()  # the scripts of a report, remembered: no fork makes them again
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(address)
        listener.listen()
        print("ready", flush=True)
        while True:
            connection, _ = listener.accept()
            size, rights, _, _ = connection.recvmsg(4, socket.CMSG_SPACE(3 * 4))
            order = b""
            while len(order) < int.from_bytes(size, "big"):
                order += connection.recv(65_536)
            streams = array.array("i", rights[0][2])
            child = os.fork()
            if child == 0:
                run(order, streams)
            for stream in streams:
                os.close(stream)
            threading.Thread(target=answer, args=(connection, child), daemon=True).start()


def answer(connection: socket.socket, child: int) -> None:
    """Send the exit status of a fork when it has ended."""
    _, status = os.waitpid(child, 0)
    with connection:
        connection.sendall(b"%d" % (os.waitstatus_to_exitcode(status) & 0xFF))


def run(order: bytes, streams: array.array[int]) -> None:
    """Become the command of an order, and end with it."""
    status = 1
    try:
        name, words, folder, environment = json.loads(order)
        for number, stream in enumerate(streams):
            os.dup2(stream, number)
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(environment)
        sys.argv = [name, *words]
        if name == "ssil-data":
            from ssil_data.cli import main

            main()
        exec(compile(sys.stdin.read(), "<stdin>", "exec"), {"__name__": "__main__"})
        status = 0
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
