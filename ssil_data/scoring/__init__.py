"""Scoring: fit an estimator on the labeled pairs, give every pair a leverage, commit one run."""

from ssil_data.scoring.scoring import (
    PRESETS,
    LeverageModel,
    Progress,
    Recipe,
    Scored,
    held_out_split,
    preset,
    rescore,
    score,
)

__all__ = [
    "PRESETS",
    "LeverageModel",
    "Progress",
    "Recipe",
    "Scored",
    "held_out_split",
    "preset",
    "rescore",
    "score",
]
