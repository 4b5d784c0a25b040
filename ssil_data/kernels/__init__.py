"""Kernel rewards: the formulas, and the engine that answers them for whole stores."""

from ssil_data.kernels.estimates import Estimate
from ssil_data.kernels.formulas import Moments, check_alpha, cor, log_kernel
from ssil_data.kernels.references import References, lcor_sums
from ssil_data.kernels.sampled import Sampled
from ssil_data.kernels.sums import Sums

__all__ = [
    "Estimate",
    "Moments",
    "References",
    "Sampled",
    "Sums",
    "check_alpha",
    "cor",
    "lcor_sums",
    "log_kernel",
]
