"""Running the command `ssil-data` inside a test."""

from __future__ import annotations

import pytest

from ssil_data.cli import main

SHORT_TRAINING = ["--steps", "96", "--environments", "2", "--horizon", "16", "--hidden", "8"]
SHORT_TRAINING += ["--boundary", "2", "--evaluations", "1", "--cloning-steps", "5"]
"""Flags of a training run that takes a moment."""


def run(*words: object) -> int:
    """Run the command with these words; return its exit status."""
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    return int(left.value.code or 0)
