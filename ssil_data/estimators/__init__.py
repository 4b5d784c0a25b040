"""Estimators of uncertainty: fitted on labeled pairs, they score how unlike those any pair is."""

from ssil_data.estimators.archive import ESTIMATORS, dump, from_json, load, to_json
from ssil_data.estimators.base import Estimator, Fitted, Uncertainty
from ssil_data.estimators.contrast import Contrast
from ssil_data.estimators.ensemble import Ensemble
from ssil_data.estimators.gpr import GPR
from ssil_data.estimators.mdn import MDN
from ssil_data.estimators.unlabeled import UnlabeledSample, sample_unlabeled
from ssil_data.estimators.vae import VAE, WindowVAE

__all__ = [
    "ESTIMATORS",
    "GPR",
    "MDN",
    "VAE",
    "Contrast",
    "Ensemble",
    "Estimator",
    "Fitted",
    "Uncertainty",
    "UnlabeledSample",
    "WindowVAE",
    "dump",
    "from_json",
    "load",
    "sample_unlabeled",
    "to_json",
]
