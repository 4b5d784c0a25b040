"""A few schemathesis cases, mutated bodies and kills; the manual says how to run more."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest

from ssil_service.server.launch import Server
from support.demonstrations import ROOT

WRITE_KEY = "writes-and-deletes-too"


@pytest.mark.parametrize(
    ("keys", "phases"),
    [
        (False, "examples,coverage,fuzzing,stateful"),
        # the thousands of bodies of `coverage` meet the same code behind a key
        (True, "examples,fuzzing,stateful"),
    ],
    ids=["open", "with keys"],
)
def test_the_service_does_what_its_openapi_document_says(
    keys: bool, phases: str, folder: Path, serve: Callable[..., Server], tmp_path: Path
):
    server = serve(folder, keys=keys)
    headers = {"X-API-Key": WRITE_KEY} if keys else {}
    url = f"{server.url}/v1/datasets/drives/runs/vae/lcor?sums=true"
    # the first query compiles the kernels: on a busy machine longer than schemathesis waits
    warm_up = httpx.post(url, json={"states": [[1, 2, 3]]}, headers=headers, timeout=60)
    assert warm_up.status_code == 200
    command = [
        *(str(Path(sys.executable).parent / "schemathesis"), "run", f"{server.url}/openapi.json"),
        *("--checks", "all", "--max-examples", "4", "--generation-deterministic", "--no-color"),
        *("--phases", phases),
        *(("-H", f"X-API-Key: {WRITE_KEY}") if keys else ()),
    ]
    environment = {
        "SCHEMATHESIS_HOOKS": "support.service_fits",
        "PYTHONPATH": str(ROOT / "tests"),
        "PATH": "/usr/bin:/bin",
        "HOME": str(tmp_path),
    }
    done = subprocess.run(
        command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-5000:]


@pytest.mark.parametrize(("what", "count"), [("mutations", 300), ("kills", 2)])
def test_mutated_bodies_and_kills_break_and_lose_nothing(what: str, count: int, tmp_path: Path):
    script = ROOT / "tests" / "support" / "service_robustness.py"
    done = subprocess.run(
        [sys.executable, str(script), what, str(count)],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stdout + done.stderr
