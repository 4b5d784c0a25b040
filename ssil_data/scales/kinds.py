"""Every kind of scale, and its settings and fitted values as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ssil_data.json_kinds import build, dump
from ssil_data.scales.base import FittedScale, Scale
from ssil_data.scales.conformal import Conformal, Rank
from ssil_data.scales.posterior import Chance, Posterior
from ssil_data.scales.ramps import MinMax, Quantile, Ramp

SCALES: dict[str, type[Scale]] = {
    scale.kind: scale for scale in (MinMax, Quantile, Conformal, Posterior)
}
"""Every scale by its kind."""

FITTED: dict[str, type[FittedScale]] = {scale.kind: scale for scale in (Ramp, Rank, Chance)}
"""Every fitted scale by its kind."""


def to_json(scale: Scale | FittedScale) -> dict[str, Any]:
    """Return settings or a fitted scale as a JSON object with its `kind`.

    Parameters
    ----------
    scale
        Either.
    """
    return dump(scale)


def from_json(json: Mapping[str, Any]) -> FittedScale:
    """Read a fitted scale from `to_json`'s object.

    Parameters
    ----------
    json
        The object.

    Raises
    ------
    InvalidInputError
        For an unknown kind, or values that do not fit.
    """
    return build("fitted scale", FITTED, json)


def settings_from_json(json: Mapping[str, Any]) -> Scale:
    """Read a scale's settings from `to_json`'s object.

    Parameters
    ----------
    json
        The object.

    Raises
    ------
    InvalidInputError
        For an unknown kind, or values that do not fit.
    """
    return build("scale", SCALES, json)
