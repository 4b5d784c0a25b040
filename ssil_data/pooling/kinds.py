"""Every kind of pooling, and its settings and fitted values as JSON."""

from __future__ import annotations

from ssil_data.json_kinds import dump, make_reader
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


to_json = dump
"""Return settings or a fitted pooling as a JSON object with its `kind`."""

from_json = make_reader("fitted pooling", FITTED)
"""Read a fitted pooling from `to_json`'s object; raises InvalidInputError for any other."""

settings_from_json = make_reader("pooling", POOLINGS)
"""Read a pooling's settings from `to_json`'s object; raises InvalidInputError for any other."""
