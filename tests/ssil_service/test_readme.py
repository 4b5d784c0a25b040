"""The service's page is true: its curls run, and every route and setting stands in it."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

import ssil_data as sd
from ssil_service import create_app
from ssil_service.server.launch import free_port
from ssil_service.settings import Settings
from support.demonstrations import ROOT, drives

PAGE = (ROOT / "service" / "README.md").read_text()
BLOCKS = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)


def test_every_curl_succeeds_in_its_order(tmp_path: Path):
    shutil.copytree(ROOT / "datasets" / "racetrack", tmp_path / "datasets" / "racetrack")
    episode = sd.Store(tmp_path / "datasets")["racetrack"].episode(40)
    states, actions = episode.states[:4].tolist(), episode.actions[:4].tolist()
    tensor = {"name": "states", "shape": [4, 29], "datatype": "FP32", "data": states}
    for name, body in (
        ("states", {"states": states}),
        ("pairs", {"states": states, "actions": actions}),
        ("infer", {"inputs": [tensor]}),
    ):
        (tmp_path / f"{name}.json").write_text(json.dumps(body))
    rows = [
        {"speed": float(s[1]), "heading": float(s[2]), "steer": float(a[1]), "lap": lap}
        for lap, drive in enumerate(drives())
        for s, a in zip(drive.states, drive.actions, strict=True)
    ]
    pq.write_table(pa.Table.from_pylist(rows), tmp_path / "laps.parquet")
    script = "\n".join(BLOCKS).replace("8765", str(free_port())).replace("-sS", "-sS --fail")
    done = subprocess.run(
        ["bash", "-ec", f"trap 'kill %1; wait' EXIT\n{script}"],
        cwd=tmp_path,
        env={"PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    assert '"state":"succeeded"' in done.stdout and "ssil_request_seconds" in done.stdout
    assert pq.read_metadata(tmp_path / "leverage.parquet").num_rows == 49_200


def test_every_route_has_its_curl(tmp_path: Path):
    asked = set()
    for line in "\n".join(BLOCKS).replace("\\\n", " ").splitlines():
        for url in re.findall(r"http://127\.0\.0\.1:8765([^ ?\"|]*)", line):
            put, body = "-T " in line, "-d " in line or "--data-binary" in line
            method = "PUT" if put else "POST" if body else "GET"
            method = next(iter(re.findall(r"-X (\w+)", line)), method)
            asked.add((method, url))
    document = create_app(Settings(store=str(tmp_path))).app.openapi()
    for path, operations in document["paths"].items():
        pattern = re.compile(re.sub(r"\{\w+\}", "[^/]+", path))
        for method in operations:
            found = any(m == method.upper() and pattern.fullmatch(url) for m, url in asked)
            assert found, f"{method.upper()} {path}"


def test_every_setting_is_named():
    for name in Settings.model_fields:
        flag, variable = f"--{name.replace('_', '-')}", f"SSIL_{name.upper()}"
        assert flag in PAGE or variable in PAGE, name
