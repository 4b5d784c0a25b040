"""What a result was made by: versions, a digest of the code that computes, the processor."""

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
)
_LIBRARY = ("*.py", "estimators/**/*.py", "kernels/*.py")
_TRAINERS = ("*.py", "envs/*.py", "experiments/cells.py", "experiments/lessons.py")
_FEATURES = ("sse4.2", "avx", "avx2", "fma", "avx512f", "avx512vl", "amx-tile", "neon", "sve")


@cache
def versions() -> dict[str, str]:
    """Return the versions that a result depends on."""
    return {"python": platform.python_version(), **{name: version(name) for name in _PACKAGES}}


@cache
def code() -> str:
    """Return a digest of the source files that compute; those that only show are left out."""
    found = hashlib.sha256()
    for package, patterns in ((ssil_data, _LIBRARY), (ssil_trainers, _TRAINERS)):
        folder = Path(next(iter(package.__path__)))
        for path in sorted({path for pattern in patterns for path in folder.glob(pattern)}):
            found.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return found.hexdigest()[:16]


@cache
def commit() -> str | None:
    """Return the commit of the checkout that the source stands in; None outside of one."""
    file = Path(__file__)

    def git(*words: str) -> str:
        asked = ["git", "-C", str(file.parent), *words]
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", file.name)
        return git("describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    except (OSError, subprocess.CalledProcessError):
        return None


def processor() -> dict[str, Any]:
    """Return the processor's name as LLVM knows it, and its vector instructions."""
    has = llvm.get_host_cpu_features()
    return {
        "architecture": platform.machine(),
        "name": llvm.get_host_cpu_name(),
        "features": [name for name in _FEATURES if has.get(name)],
    }
