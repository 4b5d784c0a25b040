"""Every kind of pooling, and its settings and fitted values as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ssil_data.json_kinds import build, dump
from ssil_data.pooling.base import FittedPooling, Pooling
from ssil_data.pooling.hidden_markov import FittedHiddenMarkov, HiddenMarkov
from ssil_data.pooling.single import FittedSingle, NoPooling
from ssil_data.pooling.window import FittedWindow, Window

POOLINGS: dict[str, type[Pooling]] = {each.kind: each for each in (NoPooling, Window, HiddenMarkov)}
"""Every pooling by its kind."""

FITTED: dict[str, type[FittedPooling]] = {
    each.kind: each for each in (FittedSingle, FittedWindow, FittedHiddenMarkov)
}
"""Every fitted pooling by its kind."""


def to_json(pooling: Pooling | FittedPooling) -> dict[str, Any]:
    """Return settings or a fitted pooling as a JSON object with its `kind`.

    Parameters
    ----------
    pooling
        Either.
    """
    return dump(pooling)


def from_json(json: Mapping[str, Any]) -> FittedPooling:
    """Read a fitted pooling from `to_json`'s object.

    Parameters
    ----------
    json
        The object.

    Raises
    ------
    InvalidInputError
        For an unknown kind, or values that do not fit.
    """
    return build("fitted pooling", FITTED, json)


def settings_from_json(json: Mapping[str, Any]) -> Pooling:
    """Read a pooling's settings from `to_json`'s object.

    Parameters
    ----------
    json
        The object.

    Raises
    ------
    InvalidInputError
        For an unknown kind, or values that do not fit.
    """
    return build("pooling", POOLINGS, json)
