"""No pooling: every pair is judged alone, as in the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ssil_data.pooling.base import FittedPooling, Pooling


@dataclass(frozen=True)
class NoPooling(Pooling):
    """Every pair is judged alone, as in the paper.

    Examples
    --------
    >>> sd.NoPooling().fit([1.0], np.array([0]))([3.0, 1.0], np.array([0, 0])).tolist()
    [3.0, 1.0]
    """

    kind: ClassVar[str] = "none"

    def fit(self, uncertainty: ArrayLike, episode: NDArray[np.int64]) -> FittedSingle:
        """Return what leaves uncertainty as it is.

        Parameters
        ----------
        uncertainty, episode
            Not used.
        """
        return FittedSingle()


@dataclass(frozen=True)
class FittedSingle(FittedPooling):
    """Leaves uncertainty as it is."""

    kind: ClassVar[str] = "none"

    def _pool(
        self, uncertainty: NDArray[np.float32], starts: NDArray[np.bool_]
    ) -> NDArray[np.floating]:
        return uncertainty
