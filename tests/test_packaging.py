"""The wheel has everything that somebody without the checkout needs; one place has the version."""

import os
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest

import ssil_data as sd
from support.demonstrations import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PACKAGES = {
    "ssil_data": ROOT / "ssil_data",
    "ssil_service": ROOT / "service" / "ssil_service",
    "ssil_trainers": ROOT / "trainers" / "ssil_trainers",
}
NO_SOURCE = ("__pycache__", ".ruff_cache", ".service")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from the checkout without a network."""
    folder = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    done = subprocess.run([*build, str(ROOT)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    (built,) = folder.glob("*.whl")
    return built


def test_the_version_is_written_once():
    assert version("ssil-data") == PROJECT["version"]
    assert sd.__version__ == PROJECT["version"]


def test_every_file_of_the_three_packages_is_in_the_wheel(wheel: Path):
    names = set(zipfile.ZipFile(wheel).namelist())
    missing = [
        f"{package}/{path.relative_to(folder)}"
        for package, folder in PACKAGES.items()
        for path in folder.rglob("*")
        if path.is_file()
        and not any(part in path.parts for part in NO_SOURCE)
        and f"{package}/{path.relative_to(folder)}" not in names
    ]
    assert not missing
    for data in ("example/racetrack.parquet", "example/card.md", "report/page.html.j2"):
        assert f"ssil_data/{data}" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_nothing_else_is_in_the_wheel(wheel: Path):
    tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == set(PACKAGES)


@pytest.mark.slow
def test_the_wheel_works_in_a_fresh_environment(wheel: Path, tmp_path: Path):
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / "venv"], check=True)
    binaries = tmp_path / "venv" / "bin"
    pip = [sys.executable, "-m", "pip", "--python", binaries / "python"]
    install = [*pip, "install", "--quiet", "--no-deps", "--no-index", "--no-compile", wheel]
    subprocess.run(install, check=True)
    # the dependencies are those of the running environment; the checkout itself is not among them
    packages = next((tmp_path / "venv" / "lib").glob("python*")) / "site-packages"
    site = Path(pytest.__file__).parents[1]
    (packages / "dependencies.pth").write_text(f"{site}\n")
    environment = {
        "PATH": f"{binaries}:{os.environ['PATH']}",
        "HOME": str(tmp_path),
        "SSIL_STORE": str(tmp_path / "store"),
    }

    def run(*words: str) -> str:
        done = subprocess.run(
            [binaries / words[0], *words[1:]],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    code = "import ssil_data, ssil_service, ssil_trainers; print(ssil_data.__file__)"
    assert run("python", "-c", code).startswith(str(packages))
    assert run("ssil-data", "--version").strip() == PROJECT["version"]
    run("ssil-data", "example")
    run("ssil-data", "score", "racetrack-example", "--estimator", "vae")
    assert "AUROC" in run("ssil-data", "show", "racetrack-example")
    run("ssil-data", "report", "racetrack-example", "-o", "report.html")
    assert (tmp_path / "report.html").stat().st_size > 100_000
    code = (
        "from ssil_data.cli import app, open_command\n"
        "for name in app: name.startswith('-') or open_command(name)"
    )
    run("python", "-c", code)
    assert "ssil-data train" in run("ssil-data", "train", "--help")
