"""Runs the code blocks of a Markdown page in their order, as a reader would who copies them."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cyclopts import CycloptsError

from ssil_data.cli import app, open_command
from ssil_service.server.launch import free_port
from support.demonstrations import ROOT

EXECUTED = frozenset({"sh", "python"})
"""Languages of blocks that are run."""
CHECKED = frozenset({"console"})
"""Languages of blocks that take too long to be run: their commands must parse."""
ILLUSTRATIONS = frozenset({"text"})
"""Languages of blocks that are no code to be copied."""
PORT = "8765"
"""The port in the pages, which a test replaces by a free one."""
_FENCE = re.compile(r"^```(\S*)[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """A fenced block of code.

    Parameters
    ----------
    language:
        The word after the fence.
    code:
        The lines between the fences.
    """

    language: str
    code: str


def read_blocks(page: Path) -> list[Block]:
    """Return every fenced block of a page; one without a known language is an error."""
    text = page.read_text(encoding="utf-8")
    blocks = [Block(*match) for match in _FENCE.findall(text)]
    assert text.count("```") == 2 * len(blocks), f"{page}: a fence that is not closed"
    for block in blocks:
        known = EXECUTED | CHECKED | ILLUSTRATIONS
        assert block.language in known, f"{page}: {block.language!r} is not one of {sorted(known)}"
    return blocks


def run_page(page: Path, folder: Path, binaries: Path | None = None) -> str:
    """Run the blocks of a page, see `run_blocks`."""
    return run_blocks(read_blocks(page), folder, binaries)


def run_blocks(blocks: Sequence[Block], folder: Path, binaries: Path | None = None) -> str:
    """Run blocks, in their order and in one shell, and return what they print.

    Servers that a block starts in the background are ended with the shell. Commands are looked for
    in `binaries` first, if given.
    """
    script = ["trap 'kill $(jobs -p) 2>/dev/null || true; wait' EXIT"]
    for block in blocks:
        if block.language == "sh":
            script.append(block.code)
        elif block.language == "python":
            script.append(f"python - <<'END_OF_PYTHON'\n{block.code}END_OF_PYTHON")
    code = "\n".join(script).replace(PORT, str(free_port())).replace("curl -sS", "curl -sS --fail")
    path = f"{binaries or ''}:{Path(sys.executable).parent}:/usr/bin:/bin".lstrip(":")
    done = subprocess.run(
        ["bash", "-ec", code],
        cwd=folder,
        env={"PATH": path, "HOME": str(folder), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{code}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def check_console(block: Block) -> None:
    """Check that every command of a console block exists and takes the options it is given."""
    lines = re.findall(r"^\$ (.*?)(?:\s+#.*)?$", block.code, re.MULTILINE)
    assert lines, f"no line of this block begins with $:\n{block.code}"
    targets = re.findall(r"^([a-z]+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for line in lines:
        words = [word for word in shlex.split(line) if not re.match(r"[A-Z_]+=", word)]
        if words[0] == "ssil-data":
            check_command(words[1:])
        elif words[0] == "make":
            assert set(words[1:]) <= set(targets), line
        elif words[0] == "python":
            assert (ROOT / words[1]).is_file(), line
        else:
            assert words[0] in ("python3", ".", " .venv/bin/pip".strip()), line


def check_command(words: list[str]) -> None:
    """Check that a command line of ssil-data parses, without running it."""
    try:
        open_command(words[0])
        app.parse_args(words, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        raise AssertionError(f"ssil-data {shlex.join(words)}: {error}") from None
