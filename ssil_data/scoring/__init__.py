"""Scoring: fit an estimator on the labeled pairs, give every pair a leverage, commit one run."""

from ssil_data.estimators.label_split import split_held_out
from ssil_data.leverage_model import LeverageModel, Scored
from ssil_data.scoring.pipeline import score
from ssil_data.scoring.recipes import PRESETS, Recipe, preset
from ssil_data.scoring.rescoring import rescore
from ssil_data.scoring.served import Progress

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
