"""Scoring: fit an estimator on the labeled pairs, give every pair a leverage, commit one run."""

from ssil_data.scoring.scoring import (
    PRESETS,
    LeverageModel,
    Progress,
    Recipe,
    Scored,
    preset,
    rescore,
    score,
    split_held_out,
)

__all__ = [
    "PRESETS",
    "LeverageModel",
    "Progress",
    "Recipe",
    "Scored",
    "preset",
    "rescore",
    "score",
    "split_held_out",
]
