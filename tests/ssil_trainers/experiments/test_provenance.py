"""What a result is marked with: versions, a digest of the code, the commit."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from ssil_trainers.experiments import provenance
from support.demonstrations import ROOT

PACKAGES = {
    "ssil_data": ROOT / "ssil_data",
    "ssil_trainers": ROOT / "trainers" / "ssil_trainers",
}
NOT_COMPUTING = (
    "ssil_data.client",
    "ssil_data.commands",
    "ssil_trainers.__init__",
    "ssil_trainers.experiments.__init__",
    "ssil_trainers.experiments.provenance",
    "ssil_trainers.experiments.tables",
)
"""They transport numbers, start the work, or hold settings that a cell's identity has anyway."""
CARRIERS = {"deltalake", "pyarrow", "safetensors", "rich", "httpx", "cyclopts", "tensorboard"}
"""Packages that carry numbers unchanged, or show them."""

IMPORTED = """
import sys
import ssil_trainers.experiments.cells
print(*(module.__file__ for name, module in sys.modules.items() if name.startswith("ssil_")))
"""


@pytest.fixture(scope="module")
def imported() -> set[Path]:
    """The files of both packages that a process imports before it computes a cell."""
    command = [sys.executable, "-c", IMPORTED]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    return {Path(name) for name in found.stdout.split()}


@pytest.fixture(scope="module")
def computing() -> set[Path]:
    """The files in the digest of the code."""
    library = provenance.find_computing_files(PACKAGES["ssil_data"], provenance.LIBRARY_FILES)
    trainers = provenance.find_computing_files(PACKAGES["ssil_trainers"], provenance.TRAINER_FILES)
    return {*library, *trainers}


def module_name(path: Path) -> str:
    for package, folder in PACKAGES.items():
        if path.is_relative_to(folder):
            return ".".join([package, *path.relative_to(folder).with_suffix("").parts])
    raise AssertionError(f"{path} is in neither package")


def test_every_module_that_a_cell_imports_is_in_the_digest_of_the_code(
    imported: set[Path], computing: set[Path]
) -> None:
    assert len(imported) > 40
    missing = {module_name(path) for path in imported - computing}
    assert {name for name in missing if not name.startswith(NOT_COMPUTING)} == set()


def test_every_package_that_a_cell_computes_with_is_among_the_versions(
    imported: set[Path], computing: set[Path]
) -> None:
    names = {
        name.partition(".")[0]
        for path in imported & computing
        for node in ast.walk(ast.parse(path.read_text()))
        for name in imported_names(node)
    }
    distributions = packages_distributions()
    needed = {distributions[name][0].lower() for name in names if name in distributions}
    assert {"numpy", "torch"} <= needed
    assert needed - CARRIERS <= set(provenance.package_versions())


def imported_names(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and node.module and not node.level:
        return [node.module]
    return []


def test_a_pattern_of_the_digest_that_matches_no_file_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "here.py").touch()
    assert provenance.find_computing_files(tmp_path, ("*.py",)) == [tmp_path / "here.py"]
    with pytest.raises(FileNotFoundError, match="moved"):
        provenance.find_computing_files(tmp_path, ("*.py", "moved/*.py"))


def test_a_commit_is_named_only_in_a_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    found = provenance.git_commit()
    assert found is None or re.fullmatch(r"[0-9a-f]{40}(-dirty)?", found)
    monkeypatch.setattr(provenance, "__file__", pytest.__file__)
    provenance.git_commit.cache_clear()
    assert provenance.git_commit() is None
    provenance.git_commit.cache_clear()
