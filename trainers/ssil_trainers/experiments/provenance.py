"""Where a result comes from: package versions, a digest of the code, the commit, the processor."""

from __future__ import annotations

import hashlib
import platform
import subprocess
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm

import ssil_data
import ssil_trainers

_PACKAGES = (
    "ssil-data",
    "torch",
    "numpy",
    "numba",
    "llvmlite",
    "gymnasium",
    "highway-env",
    "gpytorch",
    "scipy",
)
LIBRARY_FILES = (
    "*.py",
    "estimators/**/*.py",
    "field/*.py",
    "kernels/*.py",
    "pooling/*.py",
    "scales/*.py",
    "scoring/*.py",
    "store/*.py",
)
TRAINER_FILES = (
    "algorithms/*.py",
    "envs/**/*.py",
    "training/*.json",
    "training/*.py",
    "experiments/cells.py",
    "experiments/fits.py",
)
"""Files of the two packages that a result is computed by."""
_FEATURES = ("sse4.2", "avx", "avx2", "fma", "avx512f", "avx512vl", "amx-tile", "neon", "sve")


@cache
def package_versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that a result depends on."""
    return {"python": platform.python_version(), **{name: version(name) for name in _PACKAGES}}


@cache
def code_digest() -> str:
    """Return a digest of the source files that results are computed by.

    Files that only show results, or that collect demonstrations, are left out.
    """
    digest = hashlib.sha256()
    for package, patterns in ((ssil_data, LIBRARY_FILES), (ssil_trainers, TRAINER_FILES)):
        folder = Path(next(iter(package.__path__)))
        for path in find_computing_files(folder, patterns):
            digest.update(path.relative_to(folder).as_posix().encode())
            digest.update(b"\0")
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def find_computing_files(folder: Path, patterns: tuple[str, ...]) -> list[Path]:
    """List the files below a folder that match any of the patterns, each once, in order.

    Parameters
    ----------
    folder:
        Folder of a package.
    patterns:
        Patterns relative to it.

    Raises
    ------
    FileNotFoundError
        If a pattern matches nothing: the files were moved, and the digest would miss them.
    """
    found: set[Path] = set()
    for pattern in patterns:
        matching = set(folder.glob(pattern))
        if not matching:
            raise FileNotFoundError(f"no file of {folder} matches {pattern}")
        found |= matching
    return sorted(found)


@cache
def git_commit() -> str | None:
    """Return the commit of the checkout that this file is in; None outside of one."""
    file = Path(__file__)

    def git(*words: str) -> str:
        command = ["git", "-C", str(file.parent), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", file.name)
        return git("describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    except (OSError, subprocess.CalledProcessError):
        return None


def describe_processor() -> dict[str, Any]:
    """Return the processor's name as LLVM knows it, and its vector instructions."""
    available = llvm.get_host_cpu_features()
    return {
        "architecture": platform.machine(),
        "name": llvm.get_host_cpu_name(),
        "features": [name for name in _FEATURES if available.get(name)],
    }
