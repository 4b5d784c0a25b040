"""The README is true: its code runs, and every command and option it should name stands in it."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ssil_data.cli import app
from ssil_data.estimators import ESTIMATORS
from ssil_data.scales import SCALES
from ssil_data.scoring import PRESETS
from support.demonstrations import ROOT, drives

README = (ROOT / "README.md").read_text()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the README supposes: the datasets, a log of laps, states to ask about."""
    folder = tmp_path_factory.mktemp("readme")
    shutil.copytree(ROOT / "datasets", folder / "datasets")
    lines = ["speed,heading,steer,lap"]
    for lap, episode in enumerate(drives()):
        columns = zip(episode.states.tolist(), episode.actions.tolist(), strict=True)
        lines += [f"{state[1]},{state[2]},{action[1]},{lap}" for state, action in columns]
    (folder / "laps.csv").write_text("\n".join(lines) + "\n")
    np.save(folder / "states.npy", np.zeros((5, 29), np.float32))
    return folder


def test_every_block_of_code_runs_in_its_order(folder: Path):
    binaries = str(Path(sys.executable).parent)
    for language, code in re.findall(r"```(sh|python)\n(.*?)```", README, re.DOTALL):
        command = {"sh": ["sh", "-ec", code], "python": [sys.executable, "-c", code]}[language]
        run = subprocess.run(
            command,
            cwd=folder,
            env={"PATH": f"{binaries}:/usr/bin:/bin"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 0, f"{code}\n{run.stdout}\n{run.stderr}"
    assert (folder / "laps.html").stat().st_size > 100_000


def test_every_command_estimator_scale_and_preset_is_named():
    commands = [name for name in app if not name.startswith("-")]
    for name in (*commands, *ESTIMATORS, *SCALES, *PRESETS):
        assert f"`{name}`" in README or f"`--preset {name}`" in README, name


def test_every_make_target_is_named():
    targets = re.findall(r"^([a-z]+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for target in set(targets) - {"format", "clean"}:
        assert f"make {target}" in README, target
