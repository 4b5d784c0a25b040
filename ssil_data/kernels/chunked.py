"""LCoR's sums in plain torch, block by block: the engine for any host."""

from __future__ import annotations

from functools import reduce
from operator import add

import numpy as np
import torch
from numpy.typing import NDArray

from ssil_data.kernels.sums import Sums

_QUERIES, _STATES = 64, 8192


def lcor_sums(
    queries: NDArray[np.float32],
    states: NDArray[np.float32],
    leverage: NDArray[np.float32],
    *,
    alpha: float,
    contributors: int = 0,
) -> Sums:
    """Return the sums of equation 5 for queries (m, d) over states (n, d), n ≥ 1.

    States and queries are standardised already; leverage is (n,). Distances are float32, sums
    float64; a block holds 64 × 8,192 distances, or 64 × contributors where they are more. With
    fewer states than contributors, all states contribute.
    """
    block = max(_STATES, contributors)
    columns = [
        reduce(
            add,
            (
                _block(
                    rows,
                    slice(first, first + block),
                    states,
                    leverage,
                    alpha=alpha,
                    contributors=contributors,
                )
                for first in range(0, len(states), block)
            ),
        )
        for rows in np.split(queries, range(_QUERIES, len(queries), _QUERIES))
    ]
    return Sums.joined(columns)


def _block(
    queries: NDArray[np.float32],
    chosen: slice,
    states: NDArray[np.float32],
    leverage: NDArray[np.float32],
    *,
    alpha: float,
    contributors: int,
) -> Sums:
    distance = torch.cdist(_tensor(queries), _tensor(states[chosen]), p=1.0)
    log_kernel = torch.log1p(distance.double() / alpha) * (-(alpha + 1) / 2)
    log_scale = log_kernel.max(dim=1).values
    weights = torch.exp(log_kernel - log_scale[:, None])
    top = torch.topk(weights, min(contributors, weights.shape[1]), dim=1)
    return Sums(
        numerator=(weights @ _tensor(leverage[chosen]).double()).numpy(),
        denominator=weights.sum(dim=1).numpy(),
        squares=(weights * weights).sum(dim=1).numpy(),
        log_scale=log_scale.numpy(),
        nearest=top.indices.numpy() + chosen.start,
        nearest_weight=top.values.numpy(),
    )


def _tensor(array: NDArray[np.float32]) -> torch.Tensor:
    return torch.from_numpy(np.require(array, requirements=["W", "C"]))
