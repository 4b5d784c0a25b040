"""Pooling over time: quality is slow, so a pair's neighbors in its episode say what it is worth."""

from ssil_data.pooling.base import FittedPooling, Pooling
from ssil_data.pooling.hidden_markov import HiddenMarkov
from ssil_data.pooling.kinds import POOLINGS, from_json, settings_from_json, to_json
from ssil_data.pooling.single import NoPooling
from ssil_data.pooling.window import Window

__all__ = [
    "POOLINGS",
    "FittedPooling",
    "HiddenMarkov",
    "NoPooling",
    "Pooling",
    "Window",
    "from_json",
    "settings_from_json",
    "to_json",
]
