"""A field that is large enough to be sampled."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from ssil_data import LeverageField
from ssil_data.features import Standardizer

STORE = 80_000


@cache
def field() -> LeverageField:
    rng = np.random.default_rng(0)
    states = (rng.normal(size=(STORE, 6)) * [1, 2, 3, 4, 5, 6] + 100).astype(np.float32)
    leverage = (1 / (1 + np.exp(100 - states[:, 0]))).astype(np.float32)
    labeled = np.arange(STORE) < 100
    return LeverageField(states, leverage, labeled, Standardizer.of(states), 2.0)


def made_anew(**changes: Any) -> LeverageField:
    """The field with other values, that shares nothing with it."""
    return replace(field(), **changes, engine=None)


def queries() -> np.ndarray:
    return field().states[:: STORE // 200] + np.float32(0.2)
