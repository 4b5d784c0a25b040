"""What a result was made by."""

from __future__ import annotations

import re
from importlib.metadata import version

import pytest

from ssil_trainers.experiments import provenance


def test_the_compiler_is_among_the_versions_that_decide_a_result() -> None:
    assert provenance.package_versions()["llvmlite"] == version("llvmlite")


def test_a_commit_is_named_in_a_checkout_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    found = provenance.git_commit()
    assert found is None or re.fullmatch(r"[0-9a-f]{40}(-dirty)?", found)
    monkeypatch.setattr(provenance, "__file__", pytest.__file__)
    provenance.git_commit.cache_clear()
    assert provenance.git_commit() is None
    provenance.git_commit.cache_clear()
