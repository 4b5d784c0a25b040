"""The choice of α, the kernel's sharpness, for CoR: another one than for LCoR."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ssil_data.errors import InvalidInputError
from ssil_data.kernels import Moments, cor

EVEN = 12**-0.5
"""Deviation of numbers that are spread evenly over 0 to 1: the spread that is sought."""
_ALPHAS = np.geomspace(1e-2, 1e4, 61)
"""The sharpnesses that are tried; above the last, the kernel stays the same: exp(−d/2)."""


def auto_cor_alpha(standardized: NDArray[np.float32], labeled: NDArray[np.bool_]) -> float:
    """Return the sharpness α at which CoR of the demonstrations is spread most evenly.

    A reward that is about the same everywhere steers nobody. CoR compares two distances, each the
    root of a mean over a whole set of states, so that both are nearly equal wherever a state is; α
    of LCoR, whose kernel compares single states, says nothing about them. Of 61 sharpnesses the one
    is taken at which the deviation of CoR over all demonstrated states is nearest to that of even
    numbers, .29. No return is read.

    Parameters
    ----------
    standardized:
        (n, d) the demonstrated states, each dimension with mean 0 and standard deviation 1.
    labeled:
        Which of them are labeled as expert's, (n,).

    Returns
    -------
    :
        α, from .01 to 10,000.

    Raises
    ------
    InvalidInputError
        Unless some states are labeled and some are not.

    Notes
    -----
    No α spreads CoR far where the two distances are close: the sharpest kernel is exp(−d/2), and
    CoR is then σ((d_N − d_E) / 2). Mean ± deviation of CoR over the demonstrated states, as
    `python benchmarks/faithfulness.py cor` prints them:

    | set | α of LCoR | CoR with it | α by this rule | CoR with it |
    |---|---|---|---|---|
    | racetrack | 11 | .551 ± .026 | 10,000 | .574 ± .034 |
    | racetrack, 100 labels | 11 | .576 ± .034 | 10,000 | .608 ± .045 |
    | rc-lidar | 9,999 | .610 ± .023 | 10,000 | .610 ± .023 |

    Examples
    --------
    >>> states = np.array([[-1], [-0.9], [0.9], [1]], np.float32)
    >>> labeled = np.array([False, False, True, True])
    >>> round(auto_cor_alpha(states, labeled), 3)
    0.126
    """
    if labeled.all() or not labeled.any():
        raise InvalidInputError(
            f"CoR: expected labeled and unlabeled states, found {labeled.sum()} labeled of "
            f"{len(labeled)}"
        )
    expert = Moments.of(standardized[labeled])
    negative = Moments.of(standardized[~labeled])
    spreads = [float(cor(standardized, expert, negative, alpha).std()) for alpha in _ALPHAS]
    return float(_ALPHAS[np.argmin(np.abs(np.array(spreads) - EVEN))])
