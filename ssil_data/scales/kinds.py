"""Every kind of scale, and its settings and fitted values as JSON."""

from __future__ import annotations

from ssil_data.json_kinds import dump, make_reader
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


to_json = dump
"""Return settings or a fitted scale as a JSON object with its `kind`."""

from_json = make_reader("fitted scale", FITTED)
"""Read a fitted scale from `to_json`'s object; raises InvalidInputError for any other."""

settings_from_json = make_reader("scale", SCALES)
"""Read a scale's settings from `to_json`'s object; raises InvalidInputError for any other."""
