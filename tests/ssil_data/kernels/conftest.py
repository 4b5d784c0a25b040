"""Fixtures that run a test once per kind of compiled code."""

from __future__ import annotations

import pytest

from ssil_data.kernels.native import Target
from support.kernel_references import name_of, targets


@pytest.fixture(params=targets(), ids=name_of)
def target(request: pytest.FixtureRequest) -> Target | None:
    """Run a test once per target."""
    return request.param


@pytest.fixture(params=[target for target in targets() if target], ids=name_of)
def compiled_target(request: pytest.FixtureRequest) -> Target:
    """Run a test once per target that code is written for."""
    return request.param
