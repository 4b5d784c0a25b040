"""schemathesis with all checks, mutated bodies, kills: a little of each; the README has more."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from ssil_service.server.launch import Server
from support.demonstrations import ROOT


@pytest.mark.parametrize("keys", [False, True], ids=["open", "with keys"])
def test_the_service_does_what_its_openapi_document_says(
    keys: bool, folder: Path, serve: Callable[..., Server], tmp_path: Path
):
    server = serve(folder, keys=keys)
    command = [
        *(str(Path(sys.executable).parent / "schemathesis"), "run", f"{server.url}/openapi.json"),
        *("--checks", "all", "--max-examples", "4", "--generation-deterministic", "--no-color"),
        *(("-H", "X-API-Key: writes-and-deletes-too") if keys else ()),
    ]
    known = {
        "SCHEMATHESIS_HOOKS": "support.service_fits",
        "PYTHONPATH": str(ROOT / "tests"),
        "PATH": "/usr/bin:/bin",
        "HOME": str(tmp_path),
    }
    done = subprocess.run(
        command, env=known, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-5000:]


@pytest.mark.parametrize(("what", "count"), [("mutations", 300), ("kills", 2)])
def test_strangers_and_power_cuts_break_nothing(what: str, count: int, tmp_path: Path):
    script = ROOT / "tests" / "support" / "service_robustness.py"
    done = subprocess.run(
        [sys.executable, str(script), what, str(count)],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stdout + done.stderr
