"""Scales: from uncertainty to leverage in [0, 1]; pure formulas, no estimator and no files.

The paper contradicts itself here. Its equation

    l_j = (r_j - r_min) / (r_max - r_min)

gives the *largest* error leverage 1; its Algorithm 1 and its prose give it to the smallest.
Algorithm 1 holds: leverage 1 is expert-like, l_j = (r_max - r_j) / (r_max - r_min), and a larger
uncertainty never gets a larger leverage.
"""

from ssil_data.scales.base import FittedScale, Scale
from ssil_data.scales.conformal import Conformal, Rank
from ssil_data.scales.kinds import FITTED, SCALES, from_json, settings_from_json, to_json
from ssil_data.scales.posterior import Chance, Posterior
from ssil_data.scales.ramps import MinMax, Quantile, Ramp

__all__ = [
    "FITTED",
    "SCALES",
    "Chance",
    "Conformal",
    "FittedScale",
    "MinMax",
    "Posterior",
    "Quantile",
    "Ramp",
    "Rank",
    "Scale",
    "from_json",
    "settings_from_json",
    "to_json",
]
